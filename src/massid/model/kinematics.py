"""Where a robot's bodies are along a walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.conventions import to_world


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


def moved_to_root(walk: Walk, model: mujoco.MjModel, root: str) -> Walk:
    """Return a walk whose base pose and twist are those of the root, not of a link that is fixed to it.

    Args:
        walk: of another link that moves with the root.
        model: the robot.
        root: its floating base.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base, link = model.body(root).id, model.body(walk.root_body).id
    turn = data.xmat[base].reshape(3, 3).T
    offset, turned = turn @ (data.xpos[link] - data.xpos[base]), turn @ data.xmat[link].reshape(3, 3)
    back = np.empty(4)
    mujoco.mju_mat2Quat(back, turned.T.ravel())
    qpos, qvel = walk.qpos.copy(), walk.qvel.copy()
    for row, logged in zip(qpos, walk.qpos, strict=True):
        mujoco.mju_mulQuat(row[3:7], logged[3:7], back)
    qvel[:, 3:6] = walk.qvel[:, 3:6] @ turned.T  # in the body
    qpos[:, :3] -= to_world(qpos[:, 3:7], np.broadcast_to(offset, (len(qpos), 3)))
    qvel[:, :3] -= to_world(qpos[:, 3:7], np.cross(qvel[:, 3:6], offset))
    return replace(walk, root_body=root, qpos=qpos, qvel=qvel)
