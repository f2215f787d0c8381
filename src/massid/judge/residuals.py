"""What a result leaves unexplained, channel by channel, beside what the model file leaves."""

from __future__ import annotations

import numpy as np

from massid.identify.logs import PreparedLog
from massid.model.robot import Robot
from massid.observer.sensors import ExactSensors
from massid.result.checks import Residuals
from massid.result.result import Result
from massid.typing import FloatArray
from massid.walk import Segment

_LONGEST_S = 2.0
_LEAD_S = 0.3
BASE_CHANNELS = ("base position", "base attitude", "base velocity", "base turn rate")


def channel_residuals(result: Result, log: PreparedLog, robot: Robot) -> Residuals | None:
    """Run the identified and the nominal model through the first seconds of a part of a log.

    An innovation is whitened by those of the channels before it, so a fault shows in the first channel it reaches.

    Args:
        result: what was found.
        log: with its sensor model; best a part that was not fitted.
        robot: with nominal masses.

    Returns:
        None for a log without noise, or one that is too short.
    """
    walk, sensors = log.walk, log.sensors
    if isinstance(sensors, ExactSensors):
        return None
    longest = max(walk.segments, key=len)
    lead = round(_LEAD_S / walk.timestep_s)
    segment = Segment(longest.start, min(longest.stop, longest.start + lead + round(_LONGEST_S / walk.timestep_s)))
    if len(segment) < 2 * lead:
        return None
    space, point = result.unknowns()
    bank = sensors.bank(robot, space, walk.contact_bodies, walk.timestep_s, n_models=2, tangents=False)
    bank.place(np.vstack([point, space.nominal]))
    total, counted = np.zeros((2, 2 * robot.model.nv)), 0
    for part, errors in bank.replay(walk, segment, stop=longest.stop):
        values = errors.later(segment.start + lead - part.start).values
        total += bank.timestep_s * np.sum(values**2, axis=1)
        counted += values.shape[1]
    identified, nominal = total / counted
    return Residuals(
        _names(robot), _by_channel(robot, nominal), _by_channel(robot, identified), counted * walk.timestep_s
    )


def _names(robot: Robot) -> tuple[str, ...]:
    return (
        *BASE_CHANNELS,
        *(f"{joint} position" for joint in robot.joint_names),
        *(f"{joint} velocity" for joint in robot.joint_names),
    )


def _by_channel(robot: Robot, squares: FloatArray) -> FloatArray:
    """Means over the three axes of each of the base's channels, then the joints' squares."""
    nv, root, joints = robot.model.nv, robot.layout.root_dof, robot.layout.joint_dof
    base = [squares[start : start + 3].mean() for start in (root, root + 3, nv + root, nv + root + 3)]
    return np.concatenate([base, squares[joints], squares[nv + joints]])
