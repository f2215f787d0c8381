"""What happened within a sample period, when a simulated log has every second step and the mean of what acted.

A simulator moves with the velocity at the end of each step, so positions at both ends of a period and the velocity at
its end give the state in between exactly. What acted in the two halves is known as a mean only; the accelerations of
both tell the difference, through the inverse dynamics of the model with the masses that fit the log's force balance.
It is of second order in what is identified: errors of these masses hardly matter.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np

from massid.audit.balance import fitted_model, measure_balance
from massid.model.inverse import DiscreteInverseDynamics, applied, recorded_steps, takes_stages
from massid.model.robot import Robot
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.conventions import to_body
from massid.walk.refine import refined
from massid.walk.white_noise import white_level

FACTOR = 2
"""The state between samples is determined for two steps in a period only."""


def with_inner_steps(robot: Robot, coarse: Walk, fine: Walk) -> Walk | None:
    """Reconstruct states and forces of the steps between samples.

    The part of the force's change that acts on the base is logged as a wrench on it, so the base becomes a contact
    body.

    Args:
        robot: with nominal masses.
        coarse: the log, whose period holds two of the model's steps.
        fine: the same refined by interpolation, checked and aligned with the robot; its segments are kept.

    Returns:
        None if positions are noisy, for their noise would be divided by the time step, if the model's integrator moves
        otherwise, if some wrench was not measured, or if the walk is too short.
    """
    if takes_stages(robot.model) or coarse.open_axes:
        return None
    balance = measure_balance(robot, fine)
    if balance is None or max(white_level(coarse.qpos[:, :3]), white_level(coarse.qpos[:, 7:])) > 0.0:
        return None
    exact = robot.align(refined(coarse, FACTOR, semi_implicit=True))
    first = np.concatenate([np.arange(s.start, s.stop - FACTOR, FACTOR) for s in exact.segments])
    missing = _unsupplied(robot, exact, fitted_model(robot, fine, balance))
    change = np.zeros_like(missing)
    change[first] = 0.5 * (missing[first] - missing[first + 1])
    change[first + 1] = -change[first]
    layout = robot.layout
    on_base = change[:, layout.root_dof : layout.root_dof + 6]
    wrench = np.hstack([to_body(exact.qpos[:, 3:7], on_base[:, :3]), on_base[:, 3:]])
    bodies, wrenches = exact.contact_bodies, exact.wrench
    if robot.root_body not in bodies:
        bodies = (*bodies, robot.root_body)
        wrenches = np.concatenate([wrenches, np.zeros((len(exact), 1, 6))], axis=1)
    wrenches = wrenches.copy()
    wrenches[:, bodies.index(robot.root_body)] += wrench
    return replace(
        fine,
        qpos=exact.qpos,
        qvel=exact.qvel,
        effort=exact.effort + change[:, layout.joint_dof],
        wrench=wrenches,
        contact_bodies=bodies,
    )


def _unsupplied(robot: Robot, walk: Walk, model: mujoco.MjModel) -> FloatArray:
    """Generalised force that each step took beyond what the log says acted, shape (n, nv)."""
    dynamics = DiscreteInverseDynamics(model, walk.contact_bodies)
    rows = np.concatenate([np.arange(s.start, s.stop - 1) for s in walk.segments])
    steps = recorded_steps(walk, robot.layout, rows)
    missing = dynamics.forces(*steps) - applied(dynamics.jacobian(steps[0]), walk.wrench[rows])
    missing[:, robot.layout.joint_dof] -= walk.effort[rows]
    out = np.zeros((len(walk), model.nv))
    out[rows] = missing
    return out
