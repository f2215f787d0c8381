"""Where a walk's columns stand in a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massid.typing import FloatArray, IntArray


@dataclass(frozen=True)
class JointLayout:
    """Where the free joint and the one-axis joints stand in the model's qpos and qvel."""

    root_qpos: int
    root_dof: int
    joint_qpos: IntArray
    joint_dof: IntArray

    def to_qpos(self, columns: FloatArray) -> FloatArray:
        """Reorder walk columns [base pose, joints] into the model's qpos, shape (..., nq)."""
        qpos = np.empty_like(columns)
        qpos[..., self.root_qpos : self.root_qpos + 7] = columns[..., :7]
        qpos[..., self.joint_qpos] = columns[..., 7:]
        return qpos

    def to_qvel(self, columns: FloatArray) -> FloatArray:
        """Reorder walk columns [base twist, joints] into the model's qvel, shape (..., nv)."""
        qvel = np.empty_like(columns)
        qvel[..., self.root_dof : self.root_dof + 6] = columns[..., :6]
        qvel[..., self.joint_dof] = columns[..., 6:]
        return qvel
