"""What a result leaves unexplained, channel by channel, beside what the model file leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massid.identify.assembly import assemble
from massid.identify.online import BLOCK_STEPS
from massid.identify.options import IdentifyOptions
from massid.model.robot import Robot
from massid.observer.blas import single_threaded
from massid.observer.replay import replay_block, split
from massid.observer.spans import Spans
from massid.result.checks import Residuals
from massid.result.result import Result
from massid.typing import FloatArray
from massid.walk import Segment, Walk

_LONGEST_S = 2.0
_LEAD_S = 0.3
BASE_CHANNELS = ("base position", "base attitude", "base velocity", "base turn rate")


def channel_residuals(result: Result, walk: Walk, robot: Robot, options: IdentifyOptions) -> Residuals | None:
    """Run the identified and the nominal model through the first seconds of a part of a log.

    An innovation is whitened by those of the channels before it, so a fault shows in the first channel it reaches.

    Args:
        result: what was found.
        walk: aligned with the robot; best a part that was not fitted.
        robot: with nominal masses.
        options: how the result was found.

    Returns:
        None for a log without noise, or one that is too short.
    """
    if result.uncertainty is None:
        return None
    longest = max(walk.segments, key=len)
    lead = round(_LEAD_S / walk.timestep_s)
    segment = Segment(longest.start, min(longest.stop, longest.start + lead + round(_LONGEST_S / walk.timestep_s)))
    if len(segment) < 2 * lead:
        return None
    space, point = result.unknowns()
    pair = replace(options, bank_size=2)
    look_ahead = Spans.at(walk.timestep_s).look_ahead
    with single_threaded():
        noise = result.uncertainty.noise
        bank = assemble(robot, space, walk.contact_bodies, walk.timestep_s, noise, pair, tangents=False).bank
        bank.place(np.vstack([point, space.nominal]))
        total, counted = np.zeros((2, 2 * robot.model.nv)), 0
        for part in split(segment, BLOCK_STEPS):
            ahead = Segment(part.stop - 1, min(part.stop + look_ahead, longest.stop))
            block = replay_block(walk, robot.layout, part, ahead)
            if part.start == segment.start:
                bank.restart(block)
            errors = bank.advance(block).values
            if part.start >= segment.start + lead:
                total += bank.timestep_s * np.sum(errors**2, axis=1)
                counted += len(block)
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
