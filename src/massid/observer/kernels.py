"""Compiled inner loops: differences of states on the manifold of a floating base, for all models at once."""

from __future__ import annotations

import numpy as np

from massid.compiled import kernel
from massid.typing import FloatArray, IntArray


@kernel
def state_difference(
    qpos: FloatArray,
    qvel: FloatArray,
    qpos_measured: FloatArray,
    qvel_measured: FloatArray,
    root_qpos: int,
    root_dof: int,
    joint_qpos: IntArray,
    joint_dof: IntArray,
    out: FloatArray,
) -> None:
    """Write x (-) x_hat for every model: the tangent vector that leads from the model's state to the measured one.

    Orientation is the rotation vector in the model's base frame, as in mj_differentiatePos.

    Args:
        qpos: model positions, shape (N, nq).
        qvel: model velocities, shape (N, nv).
        qpos_measured: shape (nq,).
        qvel_measured: shape (nv,).
        root_qpos: address of the free joint in qpos.
        root_dof: address of the free joint in qvel.
        joint_qpos: addresses of the one-axis joints in qpos.
        joint_dof: addresses of the one-axis joints in qvel.
        out: result, shape (N, 2 nv): positions then velocities.
    """
    nv = qvel.shape[1]
    q = root_qpos + 3
    for i in range(qpos.shape[0]):
        for axis in range(3):
            out[i, root_dof + axis] = qpos_measured[root_qpos + axis] - qpos[i, root_qpos + axis]
        # The relative rotation: conjugate of the model's quaternion times the measured one.
        aw, ax, ay, az = qpos[i, q], -qpos[i, q + 1], -qpos[i, q + 2], -qpos[i, q + 3]
        bw, bx, by, bz = qpos_measured[q], qpos_measured[q + 1], qpos_measured[q + 2], qpos_measured[q + 3]
        w = aw * bw - ax * bx - ay * by - az * bz
        x = aw * bx + ax * bw + ay * bz - az * by
        y = aw * by - ax * bz + ay * bw + az * bx
        z = aw * bz + ax * by - ay * bx + az * bw
        sine = np.sqrt(x * x + y * y + z * z)
        if w < 0.0:  # the shorter way round
            w, x, y, z = -w, -x, -y, -z
        scale = 2.0 if sine < 1e-12 else 2.0 * np.arctan2(sine, w) / sine
        out[i, root_dof + 3] = scale * x
        out[i, root_dof + 4] = scale * y
        out[i, root_dof + 5] = scale * z
        for j in range(joint_dof.shape[0]):
            out[i, joint_dof[j]] = qpos_measured[joint_qpos[j]] - qpos[i, joint_qpos[j]]
        for d in range(nv):
            out[i, nv + d] = qvel_measured[d] - qvel[i, d]


@kernel
def correct_state(
    qpos: FloatArray,
    qvel: FloatArray,
    delta: FloatArray,
    root_qpos: int,
    root_dof: int,
    joint_qpos: IntArray,
    joint_dof: IntArray,
) -> None:
    """Move every model's state along its tangent vector, in place; the inverse of state_difference.

    Args:
        qpos: model positions, shape (N, nq), written to.
        qvel: model velocities, shape (N, nv), written to.
        delta: tangent vectors, shape (N, 2 nv): positions then velocities.
        root_qpos: address of the free joint in qpos.
        root_dof: address of the free joint in qvel.
        joint_qpos: addresses of the one-axis joints in qpos.
        joint_dof: addresses of the one-axis joints in qvel.
    """
    nv = qvel.shape[1]
    q = root_qpos + 3
    for i in range(qpos.shape[0]):
        for axis in range(3):
            qpos[i, root_qpos + axis] += delta[i, root_dof + axis]
        rx, ry, rz = delta[i, root_dof + 3], delta[i, root_dof + 4], delta[i, root_dof + 5]
        angle = np.sqrt(rx * rx + ry * ry + rz * rz)
        scale = 0.5 if angle < 1e-12 else np.sin(0.5 * angle) / angle
        bw, bx, by, bz = np.cos(0.5 * angle), scale * rx, scale * ry, scale * rz
        aw, ax, ay, az = qpos[i, q], qpos[i, q + 1], qpos[i, q + 2], qpos[i, q + 3]
        w = aw * bw - ax * bx - ay * by - az * bz
        x = aw * bx + ax * bw + ay * bz - az * by
        y = aw * by - ax * bz + ay * bw + az * bx
        z = aw * bz + ax * by - ay * bx + az * bw
        norm = np.sqrt(w * w + x * x + y * y + z * z)
        qpos[i, q], qpos[i, q + 1], qpos[i, q + 2], qpos[i, q + 3] = w / norm, x / norm, y / norm, z / norm
        for j in range(joint_dof.shape[0]):
            qpos[i, joint_qpos[j]] += delta[i, joint_dof[j]]
        for d in range(nv):
            qvel[i, d] += delta[i, nv + d]
