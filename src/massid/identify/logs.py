"""Several logs of one robot: masses are the robot's and shared, what sensors read wrong is each log's own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from massid.errors import BadInputError
from massid.identify.options import IdentifyOptions
from massid.identify.sensing import resolve_noise, with_nuisances
from massid.model.robot import Robot
from massid.model.unknowns.unknown import Unknown, unknowns_of
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray, IntArray
from massid.walk import Walk
from massid.walk.noise import SensorNoise


@dataclass(frozen=True)
class Log:
    """One log of an identification.

    Attributes:
        walk: its joints in the robot's order.
        noise: of its sensors; None for a log without noise.
        space: the parameters asked for, followed by this log's nuisances.
        doubts: what speaks against how it is identified, one line each.
    """

    walk: Walk
    noise: SensorNoise | None
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


def gather_logs(
    walks: Walk | Sequence[Walk], robot: Robot, space: ParameterSpace, options: IdentifyOptions
) -> tuple[Log, ...]:
    """Align one walk or several with the robot and say what is unknown about each.

    Sample periods and contact bodies may differ from log to log.

    Raises:
        BadInputError: no walk; some with and some without sensor noise, whose scores cannot be added; or errors of a
            sensor are asked for, which are another one in every walk, and there are several.
        LogError: a walk does not match the robot.
    """
    given = (walks,) if isinstance(walks, Walk) else tuple(walks)
    if not given:
        raise BadInputError("No walk to identify from: give at least one.")
    own_errors = [unknown.name for unknown in unknowns_of(space) if unknown.per_walk]
    if own_errors and len(given) > 1:
        raise BadInputError(
            f"{', '.join(own_errors)}: a sensor's error is another one in every walk; ask for it in one log at a time."
        )
    logs = []
    for one in given:
        walk = robot.align(one)
        noise = resolve_noise(walk, robot, options)
        own = space if noise is None else with_nuisances(space, robot, walk, noise, options)
        logs.append(Log(walk, noise, own, _doubts(walk, robot, options)))
    noisy = [log.walk.source for log in logs if log.noise is not None]
    clean = [log.walk.source for log in logs if log.noise is None]
    if noisy and clean:
        raise BadInputError(
            f"{noisy[0]} has sensor noise and {clean[0]} has none: identify them one at a time, or say what sensors "
            "both have (--noise white or realistic)."
        )
    return tuple(logs)


def _doubts(walk: Walk, robot: Robot, options: IdentifyOptions) -> tuple[str, ...]:
    """Say so if a log is called clean and is not."""
    if options.noise != "clean":
        return ()
    noise = resolve_noise(walk, robot, replace(options, noise="auto"))
    if noise is None:
        return ()
    return (
        f"{walk.source} is taken as --noise clean, but shows noise of {noise.joint_velocity:.2g} rad/s in the joint "
        "velocities, which no forces explain: without that option the noise is read off the log.",
    )


def join_spaces(logs: Sequence[Log]) -> JointSpace:
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
    kept = _columns_of(before, before)
    fresh = np.array([unknown.per_walk for unknown in unknowns_of(space)])
    centre = start_from(belief.centre, before, space)
    prior = LocalQuadratic.belief(centre, np.where(fresh, space.prior_precision, 0.0))
    return prior + belief.marginal(kept).embedded(centre, _columns_of(before, space))


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


def gather_warnings(logs: Sequence[Log]) -> tuple[str, ...]:
    """What reading all logs had to say, then what speaks against how they are identified."""
    read = tuple(warning for log in logs for warning in log.walk.warnings)
    return read + tuple(doubt for log in logs for doubt in log.doubts)
