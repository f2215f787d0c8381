"""A log without most of its sensors' errors, for what is computed along its motion rather than fitted to it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import convolve1d

from massid.model.inverse import DiscreteInverseDynamics, applied, recorded_steps
from massid.model.robot import Robot
from massid.typing import FloatArray, IntArray
from massid.walk import Walk

_LOADED = 0.05
"""Share of the weight that contacts must carry if they are to be corrected."""


def smoothed(walk: Walk, width_s: float) -> Walk:
    """Average every channel over a Hann window, segment by segment and without delay.

    Args:
        walk: the log.
        width_s: width of the window [s].
    """
    kernel = np.hanning(round(width_s / walk.timestep_s) + 2)[1:-1]
    if len(kernel) < 2:
        return walk
    kernel /= kernel.sum()
    quaternion = walk.qpos[:, 3:7]
    # q and -q are the same attitude: take the one that is nearer to the sample before.
    turned = np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0.0
    sign = np.concatenate([[1.0], np.where(np.cumsum(turned) % 2, -1.0, 1.0)])
    qpos = np.hstack([walk.qpos[:, :3], sign[:, None] * quaternion, walk.qpos[:, 7:]])
    qpos = _average(walk, qpos, kernel)
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    return replace(
        walk,
        qpos=qpos,
        qvel=_average(walk, walk.qvel, kernel),
        effort=_average(walk, walk.effort, kernel),
        wrench=_average(walk, walk.wrench, kernel),
    )


def _average(walk: Walk, values: FloatArray, kernel: FloatArray) -> FloatArray:
    out = np.array(values)
    for segment in walk.segments:
        rows = slice(segment.start, segment.stop)
        out[rows] = convolve1d(values[rows], kernel, axis=0, mode="nearest")
    return out


def balanced(walk: Walk, robot: Robot, rows: IntArray) -> Walk:
    """Replace torques and wrenches by such as make the robot, with its nominal masses, move as the log says.

    Wrenches change as little as it takes to carry the base, on the bodies that carry it; torques do the rest. Sensor
    offsets would otherwise push the model about, and a robot that stands still would seem to be accelerated.

    Args:
        walk: aligned with the robot, smooth.
        robot: with nominal masses.
        rows: samples at which this is done; the one after each must be in the walk.
    """
    layout = robot.layout
    dynamics = DiscreteInverseDynamics.of(robot, walk.contact_bodies, walk.timestep_s)
    steps = recorded_steps(walk, layout, rows)
    forces, jacobians = dynamics.forces(*steps), dynamics.jacobian(steps[0])
    missing = (forces - applied(jacobians, walk.wrench[rows]))[:, layout.root_dof : layout.root_dof + 6]
    on_base = jacobians[..., layout.root_dof : layout.root_dof + 6]
    weight = robot.total_mass_kg * float(np.linalg.norm(robot.model.opt.gravity))
    effort, wrench = walk.effort.copy(), walk.wrench.copy()
    for k, row in enumerate(rows):
        load = np.linalg.norm(wrench[row, :, :3], axis=1)
        if load.sum() > _LOADED * weight:
            share = np.repeat(load / load.sum(), 6)
            carried = on_base[k].reshape(-1, 6).T * share
            change = carried.T @ np.linalg.solve(carried @ carried.T, missing[k])
            wrench[row] += (change * share).reshape(-1, 6)
    effort[rows] = (forces - applied(jacobians, wrench[rows]))[:, layout.joint_dof]
    return replace(walk, effort=effort, wrench=wrench)
