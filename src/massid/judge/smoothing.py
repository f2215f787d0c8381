"""A log without most of its sensors' errors, for what is computed along its motion rather than fitted to it."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from scipy.ndimage import convolve1d

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
    model = robot.identification_model(walk.contact_bodies)
    model.opt.timestep = walk.timestep_s
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    if int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4):
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    data, layout = mujoco.MjData(model), robot.layout
    qpos, qvel = layout.to_qpos(walk.qpos), layout.to_qvel(walk.qvel)
    bodies = [model.body(name).id for name in walk.contact_bodies]
    base = np.arange(layout.root_dof, layout.root_dof + 6)
    jacobian = np.zeros((len(bodies), 6, model.nv))
    effort, wrench = walk.effort.copy(), walk.wrench.copy()
    for k in rows:
        data.qpos[:], data.qvel[:] = qpos[k], qvel[k]
        data.qacc[:] = (qvel[k + 1] - qvel[k]) / walk.timestep_s
        mujoco.mj_inverse(model, data)
        for c, body in enumerate(bodies):
            mujoco.mj_jacBody(model, data, jacobian[c, :3], jacobian[c, 3:], body)
            to_body = data.xmat[body].reshape(3, 3).T
            jacobian[c, :3], jacobian[c, 3:] = to_body @ jacobian[c, :3], to_body @ jacobian[c, 3:]
        missing = data.qfrc_inverse - np.einsum("ci,civ->v", wrench[k], jacobian)
        load = np.linalg.norm(wrench[k, :, :3], axis=1)
        if load.sum() > _LOADED * robot.total_mass_kg * float(np.linalg.norm(model.opt.gravity)):
            carried = jacobian[:, :, base].reshape(-1, 6).T * np.repeat(load / load.sum(), 6)
            change = carried.T @ np.linalg.solve(carried @ carried.T, missing[base])
            wrench[k] += (change * np.repeat(load / load.sum(), 6)).reshape(-1, 6)
        required = data.qfrc_inverse - np.einsum("ci,civ->v", wrench[k], jacobian)
        effort[k] = required[layout.joint_dof]
    return replace(walk, effort=effort, wrench=wrench)
