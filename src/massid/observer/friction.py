"""Dry friction under sensor noise: what a joint's friction was, and where that cannot be known.

Friction loss in the engine answers to every step's input. Noise in the measured wrenches shakes a light joint of the
model that stuck, or slid steadily, in reality, and shaken friction averages to less than it was: masses then make up
for what is missing. Friction is therefore not left to the noisy models. The engine computes it once, from averaged
measurements. Where a joint surely slides it is known; where it may stick its torque may be anything within the
friction loss for as long as the joint sticks, and counts as an unknown torque.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from massid.layout import JointLayout
from massid.noise import SensorNoise
from massid.observer.spans import Spans
from massid.realisation import Realisation, write_fields
from massid.typing import FloatArray

STICKING_S = 0.2
"""How long a joint is taken to stick at a time [s]."""
_SURE = 3.0
"""Deviations of an averaged velocity beyond which a joint surely moves."""
_SATURATED = 0.999
"""Share of the friction loss at which friction has no reserve left; the engine's constraint is soft."""


@dataclass(frozen=True)
class Friction:
    """Dry friction of joints along a motion.

    Attributes:
        torque: shape (n, n_joints) [N m].
        sticking: 1 where the joint may stick and its friction is not known, else 0, shape (n, n_joints).
        sliding: direction of the torque, 1 or -1, where the joint surely slides, else 0; the derivative of the torque
            by the friction loss, as far as it is known. Shape (n, n_joints).
    """

    torque: FloatArray
    sticking: FloatArray
    sliding: FloatArray

    @classmethod
    def none(cls, n: int, n_joints: int) -> Friction:
        """Joints without friction."""
        return cls(*np.zeros((3, n, n_joints)))

    def rows(self, first: int, count: int) -> Friction:
        """Some of the samples."""
        own = slice(first, first + count)
        return Friction(self.torque[own], self.sticking[own], self.sliding[own])


class StickSlip:
    """Friction torques of the joints along a measured motion.

    Args:
        model: identification model with its friction loss.
        layout: addresses of the one-axis joints.
        noise: of the sensors.
    """

    def __init__(self, model: mujoco.MjModel, layout: JointLayout, noise: SensorNoise) -> None:
        self._model = copy.copy(model)
        self._data = mujoco.MjData(self._model)
        self._loss = self._model.dof_frictionloss[layout.joint_dof].copy()
        self._joint_dof = layout.joint_dof
        self._width = Spans.at(model.opt.timestep).width
        self._velocity_std = noise.joint_velocity / np.sqrt(self._width)

    @property
    def reach(self) -> int:
        """Samples before and after one that bear upon it: a joint is uncertain next to where an average says so."""
        return self._width - 1

    @property
    def sticking_variance(self) -> FloatArray:
        """Variance of white torque noise that stands for a sticking joint, shape (n_joints,) [N^2 m^2].

        A constant torque of up to the friction loss, over the time of one sticking, is as large as white noise of this
        variance in the same direction.
        """
        return np.asarray(self._loss**2 * STICKING_S / self._model.opt.timestep)

    def place(self, realisation: Realisation) -> None:
        """Take the parameters of the first of N models."""
        write_fields(self._model, realisation)
        self._loss = self._model.dof_frictionloss[self._joint_dof].copy()

    def friction(self, qpos: FloatArray, qvel: FloatArray, force: FloatArray, wrench: FloatArray) -> Friction:
        """Friction of every joint, and where it is not certain.

        Args:
            qpos: measured positions, shape (n, nq) [rad or m].
            qvel: measured velocities, shape (n, nv) [rad/s or m/s].
            force: measured torques as generalised forces, shape (n, nv) [N m or N].
            wrench: measured wrenches, shape (n, 6 n_contacts) [N, N m].
        """
        qvel, force, wrench = (uniform_filter1d(x, self._width, axis=0, mode="mirror") for x in (qvel, force, wrench))
        model, data = self._model, self._data
        by_dof = np.zeros((len(qpos), model.nv))
        for k in range(len(qpos)):
            data.qpos[:], data.qvel[:], data.qfrc_applied[:], data.ctrl[:] = qpos[k], qvel[k], force[k], wrench[k]
            mujoco.mj_forward(model, data)
            rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
            by_dof[k, data.efc_id[rows]] = data.efc_force[rows]
        torque = by_dof[:, self._joint_dof]
        slides = np.abs(qvel[:, self._joint_dof]) > _SURE * self._velocity_std
        slides &= np.abs(torque) >= _SATURATED * self._loss
        uncertain = maximum_filter1d((~slides).astype(np.uint8), self._width, axis=0, mode="nearest")
        return Friction(
            torque=torque,
            sticking=np.where(self._loss > 0.0, uncertain, 0).astype(np.float64),
            sliding=-np.sign(qvel[:, self._joint_dof]) * (1.0 - uncertain),
        )
