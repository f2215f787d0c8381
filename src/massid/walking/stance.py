"""Standing pose by inverse kinematics: level soles on z = 0, bent knees, centre of mass above the soles' centres."""

from __future__ import annotations

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.typing import FloatArray
from massid.walking.morphology import Morphology, Sole

_ITERATIONS = 100
_TOLERANCE = 1e-10
_DAMPING = 1e-6
_STEP_LIMIT = 0.3


def standing_qpos(
    model: mujoco.MjModel, morphology: Morphology, knee_bend_rad: float, spacing_m: float | None = None
) -> FloatArray:
    """Find the pose in which the robot waits for its first step.

    Args:
        model: robot-only model.
        morphology: its parts.
        knee_bend_rad: angle by which each knee is bent, > 0.
        spacing_m: lateral distance between the soles' centres; the model's own if None.

    Returns:
        qpos, shape (nq,): the middle between the soles' centres at the origin, soles on z = 0, root level.

    Raises:
        ModelError: no such pose was found.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    data.qpos[:2] = 0.0
    _bend_legs(data, morphology, knee_bend_rad)
    spacing = morphology.foot_spacing_m if spacing_m is None else spacing_m
    targets = (np.array([0.0, spacing / 2, 0.0]), np.array([0.0, -spacing / 2, 0.0]))
    columns = np.concatenate([[0, 2], *morphology.leg_dofs]).astype(np.int64)
    error = np.inf
    for _ in range(_ITERATIONS):
        residual, jacobian = _residual(model, data, morphology, targets, knee_bend_rad)
        error = float(np.max(np.abs(residual)))
        if error < _TOLERANCE:
            return np.array(data.qpos)
        a = jacobian[:, columns]
        step = -np.linalg.solve(a.T @ a + _DAMPING * np.eye(len(columns)), a.T @ residual)
        step *= min(1.0, _STEP_LIMIT / float(np.max(np.abs(step))))
        velocity = np.zeros(model.nv)
        velocity[columns] = step
        mujoco.mj_integratePos(model, data.qpos, velocity, 1.0)
    raise ModelError(
        f"No standing pose with knees bent by {knee_bend_rad:.2f} rad: the inverse kinematics stopped at an error of"
        f" {error:.1e} after {_ITERATIONS} iterations."
    )


def _bend_legs(data: mujoco.MjData, morphology: Morphology, knee_bend_rad: float) -> None:
    """Start with bent knees, away from the singular straight leg."""
    for side in range(2):
        straight, sign = morphology.knee_straight_rad[side], morphology.knee_bend_signs[side]
        data.qpos[morphology.knee_dofs[side] + 1] = straight + sign * knee_bend_rad


def _residual(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    morphology: Morphology,
    targets: tuple[FloatArray, FloatArray],
    knee_bend_rad: float,
) -> tuple[FloatArray, FloatArray]:
    """Pose errors of both soles, knee bend error, centre-of-mass offset along x; and their Jacobian."""
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    rows, blocks = [], []
    for sole, target in zip(morphology.soles, targets, strict=True):
        position, rotation = sole_pose(data, sole)
        jacobian = np.zeros((6, model.nv))
        mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], position, sole.body_id)
        rows += [position - target, rotation_vector(rotation)]
        blocks.append(jacobian)
    knee_row, com_row = np.zeros((1, model.nv)), np.zeros((3, model.nv))
    dofs, signs = morphology.knee_dofs, morphology.knee_bend_signs
    bend = signs * (data.qpos[dofs + 1] - morphology.knee_straight_rad)
    knee_row[0, dofs] = signs / 2
    mujoco.mj_jacSubtreeCom(model, data, com_row, morphology.root_id)
    rows += [np.array([bend.mean() - knee_bend_rad]), data.subtree_com[morphology.root_id][:1]]
    return np.concatenate(rows), np.vstack([*blocks, knee_row, com_row[:1]])


def sole_pose(data: mujoco.MjData, sole: Sole) -> tuple[FloatArray, FloatArray]:
    """Position of a sole's centre [m], shape (3,), and its axes in the world, shape (3, 3)."""
    foot = data.xmat[sole.body_id].reshape(3, 3)
    return data.xpos[sole.body_id] + foot @ sole.centre, foot @ sole.rotation


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Rotation vector [rad] of a rotation matrix of less than half a turn, shape (3,)."""
    quaternion = np.empty(4)
    vector = np.empty(3)
    mujoco.mju_mat2Quat(quaternion, rotation.ravel())
    mujoco.mju_quat2Vel(vector, quaternion, 1.0)
    return vector
