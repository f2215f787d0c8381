"""Where a robot's bodies are along a walk."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from massid.typing import FloatArray


def body_rotations(model: mujoco.MjModel, qpos: FloatArray, bodies: Sequence[str]) -> FloatArray:
    """Rotation matrices from bodies to the world.

    Args:
        model: the robot.
        qpos: positions in the model's order, shape (n, nq).
        bodies: names of bodies.

    Returns:
        Shape (n, n_bodies, 3, 3).
    """
    data = mujoco.MjData(model)
    ids = [model.body(body).id for body in bodies]
    out = np.empty((len(qpos), len(ids), 3, 3))
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        out[k] = data.xmat[ids].reshape(-1, 3, 3)
    return out


def wrenches_in_bodies(
    model: mujoco.MjModel, qpos: FloatArray, wrench: FloatArray, bodies: Sequence[str], in_world: Sequence[str]
) -> FloatArray:
    """Express in their bodies those wrenches that are still expressed in the world.

    Args:
        model: the robot.
        qpos: positions in the model's order, shape (n, nq).
        wrench: force and moment on each body, shape (n, n_bodies, 6).
        bodies: names of the bodies, in the order of the columns.
        in_world: which of them to turn.
    """
    turned = wrench.copy()
    columns = [bodies.index(body) for body in in_world]
    rotations = body_rotations(model, qpos, in_world)
    for part in (slice(0, 3), slice(3, 6)):
        turned[:, columns, part] = np.einsum("kcji,kcj->kci", rotations, wrench[:, columns, part])
    return turned


def compensation_torques(model: mujoco.MjModel, qpos: FloatArray) -> FloatArray:
    """Generalised forces of actuators that compensate gravity (`actuatorgravcomp`), shape (n, nv) [N m or N].

    Args:
        model: the robot.
        qpos: positions in the model's order, shape (n, nq).
    """
    data = mujoco.MjData(model)
    by_actuator = model.jnt_actgravcomp[model.dof_jntid].astype(bool)
    out = np.zeros((len(qpos), model.nv))
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        out[k, by_actuator] = data.qfrc_gravcomp[by_actuator]
    return out
