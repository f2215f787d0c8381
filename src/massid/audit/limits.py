"""Do joint positions stay where the model says that its joints can go?"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk

SLACK = 0.35
"""How far beyond a limit a position may be [rad or m]: soft limits and zero offsets of encoders."""
FREE_REACH = 4.0 * np.pi
"""No joint without limits turns by more than two turns [rad] or slides that far [m]."""
_SHOWN = 4


@dataclass(frozen=True)
class _Range:
    """Where joints may be and where they are [rad or m], each of shape (n_j,)."""

    low: FloatArray
    high: FloatArray
    least: FloatArray
    most: FloatArray

    @classmethod
    def of(cls, robot: Robot, walk: Walk) -> _Range:
        model, positions = robot.model, walk.qpos[:, 7:]
        ids = [model.joint(name).id for name in robot.joint_names]
        limited = model.jnt_limited[ids].astype(bool)
        low = np.where(limited, model.jnt_range[ids, 0], -FREE_REACH)
        high = np.where(limited, model.jnt_range[ids, 1], FREE_REACH)
        return cls(low, high, positions.min(axis=0), positions.max(axis=0))

    def beyond(self, factor: float = 1.0) -> FloatArray:
        """How far beyond a limit the joints get if their positions are multiplied by a factor."""
        ends = np.sort(np.stack([factor * self.least, factor * self.most]), axis=0)
        return np.asarray(np.maximum(self.low - ends[0], ends[1] - self.high))


def limit_suspicions(robot: Robot, walk: Walk) -> list[str]:
    """Name joints that are logged where they cannot be: degrees, another zero, order or sign, another robot.

    Args:
        robot: with the limits of its joints.
        walk: aligned with the robot.
    """
    found = _Range.of(robot, walk)
    beyond = found.beyond()
    wrong = [int(k) for k in np.argsort(-beyond) if beyond[k] > SLACK]
    if not wrong:
        return []
    listed = ", ".join(
        f"{robot.joint_names[k]} {found.least[k]:.3g} .. {found.most[k]:.3g} (the model allows {found.low[k]:.3g} .. "
        f"{found.high[k]:.3g})"
        for k in wrong[:_SHOWN]
    )
    more = f" and {len(wrong) - _SHOWN} more" if len(wrong) > _SHOWN else ""
    said = f"joint positions leave the model's limits: {listed}{more}: they"
    if in_degrees(robot, walk):
        return [f"{said} look as if they were in degrees (position: scale: 0.0174533, and the velocity's, too?)."]
    if len(turned_joints(robot, walk)) == len(wrong):
        return [f"{said} look as if their sign were turned: the axes point the other way in the model."]
    return [
        f"{said} may be in degrees (scale: 0.0174533), have another zero or sign, or be in another order than the "
        "joint names."
    ]


def turned_joints(robot: Robot, walk: Walk) -> list[int]:
    """Joints that are logged where they cannot be, but could with the other sign."""
    found = _Range.of(robot, walk)
    return np.flatnonzero((found.beyond() > SLACK) & (found.beyond(-1.0) <= SLACK)).tolist()


def in_degrees(robot: Robot, walk: Walk) -> bool:
    """Whether some joints are where none can be, and all are where they can if their positions were in degrees."""
    found = _Range.of(robot, walk)
    ids = [robot.model.joint(name).id for name in robot.joint_names]
    turns = robot.model.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_HINGE)
    far, fit = found.beyond() > FREE_REACH, found.beyond(np.pi / 180.0) <= SLACK
    return bool((far & turns).any() and fit[turns].all())
