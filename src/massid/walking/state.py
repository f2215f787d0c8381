"""Kinematics and dynamics of the walker's own model at one measured state."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.typing import FloatArray
from massid.walking.footsteps import FootPose
from massid.walking.morphology import Morphology, Sole
from massid.walking.stance import sole_pose


@dataclass(frozen=True)
class Frame:
    """A point fixed to a body: where it is, how it moves, and what moves it.

    Attributes:
        position: [m], shape (3,).
        rotation: axes in the world, shape (3, 3).
        velocity: linear [m/s] and angular [rad/s], in the world, shape (6,).
        jacobian: of velocity by qvel, shape (6, nv).
        drift: acceleration at zero qacc [m/s^2, rad/s^2], shape (6,).
    """

    position: FloatArray
    rotation: FloatArray
    velocity: FloatArray
    jacobian: FloatArray
    drift: FloatArray

    @property
    def yaw_rad(self) -> float:
        """Heading of the x axis."""
        return float(np.arctan2(self.rotation[1, 0], self.rotation[0, 0]))

    @property
    def level_pose(self) -> FootPose:
        """Position and heading."""
        return FootPose(position=self.position.copy(), yaw_rad=self.yaw_rad)


class RobotState:
    """The model at the measured state; `update` fills everything.

    Args:
        model: robot-only model, owned by this object.
        morphology: its parts.

    Attributes:
        qpos: as measured, shape (nq,).
        qvel: as measured, shape (nv,).
        inertia: joint-space inertia matrix with armature, shape (nv, nv).
        bias: Coriolis, centrifugal and gravity terms minus passive forces [N m], shape (nv,).
        com: centre of mass [m], shape (3,).
        com_velocity: its rate [m/s], shape (3,).
        angular_momentum: about the centre of mass [N m s], shape (3,).
        mass_kg: total mass of the model.
        feet: left sole, right sole.
        pelvis: frame of the root body.
        torso: frame of the torso body.
    """

    feet: tuple[Frame, Frame]
    pelvis: Frame
    torso: Frame

    def __init__(self, model: mujoco.MjModel, morphology: Morphology) -> None:
        self._model = model
        self._morphology = morphology
        self._data = mujoco.MjData(model)
        nv = model.nv
        self.inertia = np.zeros((nv, nv))
        self.bias = np.zeros(nv)
        self.mass_kg = float(model.body_subtreemass[morphology.root_id])
        self._jacobian_rate = np.zeros((6, nv))

    @property
    def qpos(self) -> FloatArray:
        """As measured, shape (nq,)."""
        qpos: FloatArray = self._data.qpos
        return qpos

    @property
    def qvel(self) -> FloatArray:
        """As measured, shape (nv,)."""
        qvel: FloatArray = self._data.qvel
        return qvel

    def update(self, qpos: FloatArray, qvel: FloatArray) -> None:
        """Take a measured state."""
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_subtreeVel(model, data)
        mujoco.mj_fullM(model, data, self.inertia)
        np.subtract(data.qfrc_bias, data.qfrc_passive, out=self.bias)
        root = self._morphology.root_id
        self.com = data.subtree_com[root].copy()
        self.com_velocity = data.subtree_linvel[root].copy()
        self.angular_momentum = data.subtree_angmom[root].copy()
        left, right = self._morphology.soles
        self.feet = (self._sole_frame(left), self._sole_frame(right))
        self.pelvis = self._body_frame(root)
        self.torso = self.pelvis if self._morphology.torso_id == root else self._body_frame(self._morphology.torso_id)

    def _sole_frame(self, sole: Sole) -> Frame:
        position, rotation = sole_pose(self._data, sole)
        return self._frame(sole.body_id, position, rotation)

    def _body_frame(self, body: int) -> Frame:
        rotation = self._data.xmat[body].reshape(3, 3).copy()
        return self._frame(body, self._data.xpos[body].copy(), rotation)

    def _frame(self, body: int, position: FloatArray, rotation: FloatArray) -> Frame:
        jacobian = np.empty((6, self._model.nv))
        rate = self._jacobian_rate
        mujoco.mj_jac(self._model, self._data, jacobian[:3], jacobian[3:], position, body)
        mujoco.mj_jacDot(self._model, self._data, rate[:3], rate[3:], position, body)
        qvel = self._data.qvel
        return Frame(
            position=position,
            rotation=rotation,
            velocity=jacobian @ qvel,
            jacobian=jacobian,
            drift=rate @ qvel,
        )
