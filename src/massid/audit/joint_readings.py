"""Other readings of the joints that would explain the forces: left and right swapped, axes that point the other way.

They change the motion, so the force balance is measured anew for each: looked at only where something is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from massid.audit.balance import measure_balance
from massid.audit.conventions import swapped_sides
from massid.audit.forces import Rest, check_rest
from massid.audit.limits import turned_joints
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk

_STEPS = 400
_BETTER, _BETTER_IN_NOISE = 0.3, 0.6
"""Share of the unexplained force that another reading may leave at most; noise is left by all of them."""
_SHOWN = 4


def better_reading(robot: Robot, walk: Walk, given: Rest) -> str | None:
    """What is probably wrong with the joints, and the setting that cures it; None if nothing that was tried helps.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
        given: what the walk leaves unexplained as it was read, or by another convention of its forces.
    """
    left = given.share if given.then is None else given.then
    for reason, read in _readings(robot, walk):
        balance = measure_balance(robot, read, steps=_STEPS)
        if balance is None:
            return None
        rest = check_rest(robot, read, balance)
        if rest.sound and rest.share < (_BETTER if given.beyond_noise else _BETTER_IN_NOISE) * left:
            return (
                f"{given.share:.0%} of the force that the motion took is explained neither by the log nor by any link "
                f"masses: {reason} (then {rest.share:.0%})."
            )
    return None


def _readings(robot: Robot, walk: Walk) -> Iterator[tuple[str, Walk]]:
    """Readings with torques that were written like the states first, then with torques that are right as they are."""
    turned = turned_joints(robot, walk)
    names = robot.joint_names
    ones = np.ones(len(names))
    signs = [(_some(names, turned), np.where(np.isin(np.arange(len(names)), turned), -1.0, 1.0)), ("all joints", -ones)]
    for said, factors in signs if turned else ():
        axes = f"the axes of {said} look as if they pointed the other way in the model"
        yield f"{axes} (turn `axis` and `range` there, or the log's numbers)", _signed(walk, factors, factors)
        yield f"{axes}, but for their torques (turn the log's positions and velocities)", _signed(walk, factors, ones)
    as_named = list(range(len(names)))
    for said, order in swapped_sides(robot, walk.contact_bodies):
        reason = f"left and right {said} look swapped (joints: names, or rename)"
        yield reason, _ordered(walk, order, order)
        yield f"{reason}, but for their torques", _ordered(walk, order, as_named)


def _some(names: Sequence[str], places: Sequence[int]) -> str:
    more = f" and {len(places) - _SHOWN} more" if len(places) > _SHOWN else ""
    return ", ".join(names[k] for k in places[:_SHOWN]) + more


def _signed(walk: Walk, signs: FloatArray, of_effort: FloatArray) -> Walk:
    qpos, qvel = walk.qpos.copy(), walk.qvel.copy()
    qpos[:, 7:] *= signs
    qvel[:, 6:] *= signs
    return replace(walk, qpos=qpos, qvel=qvel, effort=walk.effort * of_effort)


def _ordered(walk: Walk, order: Sequence[int], of_effort: Sequence[int]) -> Walk:
    qpos = np.hstack([walk.qpos[:, :7], walk.qpos[:, 7:][:, order]])
    qvel = np.hstack([walk.qvel[:, :6], walk.qvel[:, 6:][:, order]])
    return replace(walk, qpos=qpos, qvel=qvel, effort=walk.effort[:, of_effort])
