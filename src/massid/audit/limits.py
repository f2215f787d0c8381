"""Do joint positions stay where the model says that its joints can go?"""

from __future__ import annotations

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.walk import Walk

SLACK = 0.35
"""How far beyond a limit a position may be [rad or m]: soft limits and zero offsets of encoders."""
FREE_REACH = 4.0 * np.pi
"""No joint without limits turns by more than two turns [rad] or slides that far [m]."""
_SHOWN = 4


def limit_suspicions(robot: Robot, walk: Walk) -> list[str]:
    """Name joints that are logged where they cannot be: degrees, another zero, order or sign, another robot.

    Args:
        robot: with the limits of its joints.
        walk: aligned with the robot.
    """
    model, positions = robot.model, walk.qpos[:, 7:]
    ids = [model.joint(name).id for name in robot.joint_names]
    limited = model.jnt_limited[ids].astype(bool)
    low = np.where(limited, model.jnt_range[ids, 0], -FREE_REACH)
    high = np.where(limited, model.jnt_range[ids, 1], FREE_REACH)
    least, most = positions.min(axis=0), positions.max(axis=0)
    beyond = np.maximum(low - least, most - high)
    wrong = [int(k) for k in np.argsort(-beyond) if beyond[k] > SLACK]
    if not wrong:
        return []
    listed = ", ".join(
        f"{robot.joint_names[k]} {least[k]:.3g} .. {most[k]:.3g} (the model allows {low[k]:.3g} .. {high[k]:.3g})"
        for k in wrong[:_SHOWN]
    )
    more = f" and {len(wrong) - _SHOWN} more" if len(wrong) > _SHOWN else ""
    if in_degrees(robot, walk):
        return [
            f"joint positions leave the model's limits: {listed}{more}: they look as if they were in degrees "
            "(position: scale: 0.0174533, and the velocity's, too?)."
        ]
    return [
        f"joint positions leave the model's limits: {listed}{more}: they may be in degrees (scale: 0.0174533), have "
        "another zero or sign, or be in another order than the joint names."
    ]


def in_degrees(robot: Robot, walk: Walk) -> bool:
    """Whether some joints are where none can be, and all are where they can if their positions were in degrees."""
    positions = walk.qpos[:, 7:]
    ids = [robot.model.joint(name).id for name in robot.joint_names]
    limited = robot.model.jnt_limited[ids].astype(bool)
    turns = robot.model.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_HINGE)
    low = np.where(limited, robot.model.jnt_range[ids, 0], -FREE_REACH)
    high = np.where(limited, robot.model.jnt_range[ids, 1], FREE_REACH)
    least, most = positions.min(axis=0), positions.max(axis=0)
    far = np.maximum(low - least, most - high) > FREE_REACH
    fit = np.maximum(low - np.radians(least), np.radians(most) - high) <= SLACK
    return bool((far & turns).any() and fit[turns].all())
