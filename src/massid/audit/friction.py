"""Do joints move as if they had dry friction that the model lacks? Most URDFs say nothing of it."""

from __future__ import annotations

import numpy as np

from massid.audit.balance import Balance
from massid.audit.balance_fit import fit_balance
from massid.model.robot import Robot
from massid.walk import Walk
from massid.walk.white_noise import white_level

_SURE = 5.0
"""Deviations by which a friction loss must differ from nothing."""
_WORTH = 0.005
"""Share of a joint's largest torque below which friction is not worth a word."""
_LEAST_SPEED = 0.02
"""Speed below which a joint is not said to slide [rad/s]; or three deviations of the noise of its velocity."""


def missing_friction(robot: Robot, walk: Walk, balance: Balance) -> str | None:
    """Name the joints that slide under a force against their motion, though the model gives them no friction loss.

    Args:
        robot: with nominal masses.
        walk: aligned with the robot.
        balance: of this walk.

    Returns:
        A line for the user; None if there is no such joint, or if some wrench was not measured.
    """
    dofs = robot.layout.joint_dof
    without = np.flatnonzero(robot.model.dof_frictionloss[dofs] == 0.0)
    if not len(without):
        return None
    if walk.open_axes:  # what is left once the feet may have exerted anything does not tell joints apart
        return None
    velocity = walk.qvel[balance.rows, 6:]
    speed = max(_LEAST_SPEED, 3.0 * white_level(walk.qvel[:, 6:]))
    count = len(without)
    columns = np.zeros((len(balance.rows), robot.model.nv, 2 * count))
    for k, joint in enumerate(without.tolist()):
        columns[:, dofs[joint], k] = np.tanh(velocity[:, joint] / speed)
        columns[:, dofs[joint], count + k] = velocity[:, joint]  # what grows with speed is no dry friction
    fit = fit_balance(robot, walk, balance, columns)
    friction, std = fit.more[:count], fit.more_std[:count]
    worth = _WORTH * np.abs(walk.effort[balance.rows][:, without]).max(axis=0)
    found = np.flatnonzero((friction > _SURE * std) & (friction > worth))
    if not len(found):
        return None
    found = found[np.argsort(-friction[found])]
    names = [robot.joint_names[int(without[k])] for k in found]
    loss = friction[found]
    size = f"{loss.min():.2g} to {loss.max():.2g}" if len(loss) > 1 else f"{loss[0]:.2g}"
    return (
        f"{', '.join(names)}: dry friction of {size} N m seems to hold these joints, which {robot.source} lacks: "
        "ask for it (`friction`), or put it into the model (frictionloss; in a URDF <dynamics friction>)."
    )
