"""Several logs of one robot: masses are the robot's and shared, what sensors read wrong is each log's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.model.unknowns.unknown import Unknown, unknowns_of
from massid.observer.sensors import SensorModel
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray, IntArray
from massid.walk import Walk


@dataclass(frozen=True)
class PreparedLog:
    """One log, ready to be identified from.

    Attributes:
        walk: its joints in the robot's order.
        sensors: what its sensors are taken to do.
        space: the parameters asked for, followed by this log's nuisances.
        doubts: what speaks against how it is identified, one line each.
    """

    walk: Walk
    sensors: SensorModel
    space: ParameterSpace
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True)
class JointSpace:
    """The unknowns of all logs together.

    Attributes:
        space: the parameters asked for, then all nuisances; those of a sensor carry the number of their log.
        columns: for each log, where the coordinates of its own space are.
    """

    space: ParameterSpace
    columns: tuple[IntArray, ...]


def join_spaces(logs: Sequence[PreparedLog]) -> JointSpace:
    """Put the unknowns of all logs side by side: masses once, sensors' errors once for each log."""
    if len(logs) == 1:
        return JointSpace(logs[0].space, (np.arange(len(logs[0].space)),))
    unknowns, columns = _lasting(logs[0].space), []
    shared = {unknown.name: k for k, unknown in enumerate(unknowns)}
    for number, log in enumerate(logs, start=1):
        own = []
        for unknown in unknowns_of(log.space):
            if unknown.per_walk:
                own.append(len(unknowns))
                unknowns.append(unknown.of_log(number))
            else:
                own.append(shared[unknown.name])
        columns.append(np.array(own, dtype=np.int64))
    return JointSpace(ParameterSpace(tuple(unknowns)), tuple(columns))


def hand_over(belief: LocalQuadratic, before: ParameterSpace, space: ParameterSpace) -> LocalQuadratic:
    """What one walk taught, as the belief that the next begins with.

    Errors of the first walk's sensors are marginalised out; those of the next one's have their prior. Priors of what is
    common are in the belief already.

    Args:
        belief: at the end of a walk, its prior included.
        before: that walk's unknowns.
        space: the next walk's unknowns.
    """
    fresh = np.array([unknown.per_walk for unknown in unknowns_of(space)])
    centre = start_from(belief.centre, before, space)
    prior = LocalQuadratic.belief(centre, np.where(fresh, space.prior_precision, 0.0))
    return prior + belief.marginal(_columns_of(before, before)).embedded(centre, _columns_of(before, space))


def start_from(point: FloatArray, before: ParameterSpace, space: ParameterSpace) -> FloatArray:
    """A point of one walk's unknowns as a point of the next one's, whose sensors have no error yet."""
    moved = space.nominal.copy()
    moved[_columns_of(before, space)] = point[_columns_of(before, before)]
    return moved


def _lasting(space: ParameterSpace) -> list[Unknown]:
    """The unknowns that are not an error of a walk's sensors."""
    return [unknown for unknown in unknowns_of(space) if not unknown.per_walk]


def _columns_of(before: ParameterSpace, space: ParameterSpace) -> IntArray:
    """Where the unknowns that are not an error of a walk's sensors are in another space."""
    return np.array([space.names.index(unknown.name) for unknown in _lasting(before)], dtype=np.int64)
