"""From walks and options to prepared logs: sensors chosen, nuisances named, once for each log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from massid.errors import BadInputError
from massid.identify.inference import inference_for
from massid.identify.logs import PreparedLog
from massid.identify.options import IdentifyOptions
from massid.identify.sensing import choose_sensors, clean_doubts, coarse_doubts
from massid.identify.stepping import with_suitable_steps
from massid.model.robot import Robot
from massid.model.unknowns.unknown import unknowns_of
from massid.observer.ground import with_ground
from massid.observer.sensors import ExactSensors, NoisySensors, SensorModel
from massid.search.parameters import ParameterSpace
from massid.walk import Walk


def prepare_logs(
    walks: Sequence[Walk],
    robot: Robot,
    asked: ParameterSpace,
    options: IdentifyOptions,
    exact: Sequence[bool] | None = None,
) -> tuple[PreparedLog, ...]:
    """Align walks with the robot, choose their sensor models and say what is unknown about each.

    Feet whose wrench no sensor measures are judged with the nominal masses. Sample periods and contact bodies may
    differ from log to log.

    Args:
        walks: of the same robot.
        robot: with nominal masses.
        asked: the parameters asked for.
        options: how to identify.
        exact: for each walk, whether physics is known to explain it to rounding; default unknown.

    Raises:
        BadInputError: no walk; some with and some without sensor noise, whose scores cannot be added; or an error of a
            sensor is asked for, which is another one in every walk, and there are several.
        LogError: a walk does not match the robot.
    """
    if not walks:
        raise BadInputError("No walk to identify from: give at least one.")
    own_errors = [unknown.name for unknown in unknowns_of(asked) if unknown.per_walk and not unknown.tangent]
    if own_errors and len(walks) > 1:
        raise BadInputError(
            f"{', '.join(own_errors)}: a sensor's error is another one in every walk; ask for it in one log at a time."
        )
    logs = []
    for k, one in enumerate(walks):
        walk = robot.align(one)
        sensors = choose_sensors(walk, robot, options, explained=exact is not None and exact[k])
        notes: tuple[str, ...] = ()
        walk = with_ground(walk, robot, sensors.noise if isinstance(sensors, NoisySensors) else None)
        if isinstance(sensors, NoisySensors):
            sensors, notes = with_suitable_steps(sensors, walk, robot, asked)
            notes = (*coarse_doubts(walk, options, sensors), *notes)
        log = prepare_log(walk, robot, asked, sensors, options)
        logs.append(replace(log, doubts=(*log.doubts, *notes)))
    noisy = [log.walk.source for log in logs if isinstance(log.sensors, NoisySensors)]
    clean = [log.walk.source for log in logs if isinstance(log.sensors, ExactSensors)]
    if noisy and clean:
        raise BadInputError(
            f"{noisy[0]} has sensor noise and {clean[0]} has none: identify them one at a time, or say what sensors "
            "both have (`noise=white` or `noise=realistic`)."
        )
    return tuple(logs)


def prepare_log(
    walk: Walk, robot: Robot, asked: ParameterSpace, sensors: SensorModel, options: IdentifyOptions
) -> PreparedLog:
    """One log with a sensor model that was chosen already; its joints are in the robot's order."""
    space = inference_for(sensors).unknowns(asked, robot, walk, options)
    return PreparedLog(walk, sensors, space, clean_doubts(walk, robot, options))
