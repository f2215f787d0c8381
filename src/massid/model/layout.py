"""Where a walk's columns stand in a model."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.errors import LogError, ModelError, unknown_name
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


@dataclass(frozen=True)
class Channels:
    """Where the joints and the contact sensors of a robot stand among the columns of a motion, by name.

    Attributes:
        model: of the robot, with nominal values.
        layout: addresses in it.
        joint_names: the one-axis joints, in the layout's order.
        contact_bodies: bodies whose wrench is measured, in the order of the identification model's controls.
    """

    model: mujoco.MjModel
    layout: JointLayout
    joint_names: tuple[str, ...]
    contact_bodies: tuple[str, ...]

    def joint(self, name: str) -> int:
        """Number of a joint among the one-axis joints.

        Raises:
            ModelError: no such joint.
        """
        if name not in self.joint_names:
            raise ModelError(unknown_name("joint", name, self.joint_names, "The robot"))
        return self.joint_names.index(name)

    def dof(self, joint: str) -> int:
        """Degree of freedom that a joint is.

        Raises:
            ModelError: no such joint.
        """
        return int(self.layout.joint_dof[self.joint(joint)])

    def axis(self, body: str, axis: int) -> int:
        """Column of one axis of a contact sensor; 0-2 are forces, 3-5 moments.

        Raises:
            LogError: the wrench on this body is not measured.
        """
        if body not in self.contact_bodies:
            raise LogError(unknown_name("contact sensor", body, self.contact_bodies, "The log"))
        return 6 * self.contact_bodies.index(body) + axis
