"""Weighing with feet whose wrenches no sensor measures: which of them carry follows from the masses, and these from it.

Inverse dynamics with the model file's masses say roughly which feet carry; the masses found with that say it well. A
log is therefore weighed again with what was judged anew, from where the search ended.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from massid.identify.logs import PreparedLog, join_spaces
from massid.identify.offline import identify_offline
from massid.identify.options import IdentifyOptions
from massid.identify.progress import Progress, never, part_of, silent
from massid.model.robot import Robot
from massid.observer.ground import AT_FIRST, MASSES_FOUND, WITHOUT_NOISE, Judgement, with_ground
from massid.observer.sensors import NoisySensors
from massid.result.result import Result
from massid.typing import FloatArray
from massid.walk import Walk

_MaybeWalk = TypeVar("_MaybeWalk", Walk, Walk | None)

ROUGH_PASSES = 6
"""Of a first weighing over a log that is replayed: contacts need the masses to some tenths of a kilogram."""


def on_ground(
    log: PreparedLog, robot: Robot, judgement: Judgement = AT_FIRST, point: FloatArray | None = None
) -> PreparedLog:
    """A log with its feet judged at a point of its unknowns; default the nominal one."""
    noise = log.sensors.noise if isinstance(log.sensors, NoisySensors) else None
    realisation = None if point is None else robot.realise(log.space, point, log.walk.contact_bodies)
    return replace(log, walk=with_ground(log.walk, robot, noise, judgement, realisation))


def identify_on_ground(
    logs: Sequence[PreparedLog],
    robot: Robot,
    options: IdentifyOptions,
    progress: Progress = silent,
    stop: Callable[[], bool] = never,
) -> tuple[Result, tuple[PreparedLog, ...]]:
    """Identify offline, judging anew which feet carry as often as that helps.

    Args:
        logs: with feet judged at the nominal masses.
        robot: with nominal masses.
        options: how to identify.
        progress: told the fraction done.
        stop: asked now and then.

    Returns:
        The result, and the logs with feet as they were judged for it.

    Raises:
        MassidError: see `identify_offline`.
    """
    started, logs = time.perf_counter(), tuple(logs)
    judgements = _judgements(logs[0])
    share = 1.0 / (1 + len(judgements))
    rough = replace(options, passes=min(options.passes, ROUGH_PASSES))
    result = identify_offline(logs, robot, rough, part_of(progress, 0.0, share), stop)
    for k, judgement in enumerate(judgements, start=1):
        if result.stopped:
            break
        start, columns = end_of(result), join_spaces(logs).columns
        logs = tuple(on_ground(log, robot, judgement, start[own]) for log, own in zip(logs, columns, strict=True))
        result = identify_offline(logs, robot, options, part_of(progress, k * share, (k + 1) * share), stop, start)
    return replace(result, wall_s=time.perf_counter() - started), logs


def as_judged(
    walks: Sequence[_MaybeWalk], logs: Sequence[PreparedLog], robot: Robot, result: Result
) -> tuple[_MaybeWalk, ...]:
    """Walks of the same logs, or parts of them, with feet judged as a result has them.

    Args:
        walks: one for each log; None where there is none.
        logs: as they were identified.
        robot: with nominal masses.
        result: of them.
    """
    point, columns, judgement = end_of(result), join_spaces(logs).columns, _judgements(logs[0])[-1]
    return tuple(
        walk if walk is None else on_ground(replace(log, walk=walk), robot, judgement, point[own]).walk
        for walk, log, own in zip(walks, logs, columns, strict=True)
    )


def _judgements(log: PreparedLog) -> tuple[Judgement, ...]:
    """How feet are judged in each weighing after the first."""
    return (MASSES_FOUND,) if isinstance(log.sensors, NoisySensors) else WITHOUT_NOISE


def end_of(result: Result) -> FloatArray:
    """Where a search ended, in the space of all logs' unknowns, shape (n,); nominal what noise hides."""
    if result.uncertainty is None:
        return result.estimate
    asked = np.where(result.excitation.identifiable, result.estimate, result.space.nominal)
    return np.concatenate([asked, result.uncertainty.nuisance_estimate])


def said_of_ground(logs: Sequence[PreparedLog]) -> tuple[str, ...]:
    """How feet without sensors were taken, one line for each log that has some."""
    lines = []
    for log in logs:
        walk = log.walk
        rows = np.concatenate([np.arange(part.start, part.stop) for part in walk.segments])
        in_the_air = ~walk.wrench[rows].any(axis=2)
        blind = np.flatnonzero(~walk.measured.any(axis=1))
        if not len(blind):
            continue
        shares = ", ".join(f"{walk.contact_bodies[foot]} {in_the_air[:, foot].mean():.0%}" for foot in blind)
        lines.append(
            f"{walk.source}: no sensor reads what the ground exerts, so the scale of all masses rests on the torques. "
            f"Feet are taken to be in the air for so much of the time: {shares}; only there their own masses show."
        )
    return tuple(lines)
