"""What it would take of a joint's dry friction to hold it, and how well measurements tell.

The engine's friction constraint is soft: below the friction loss its force is linear in the motion, f = -D (a + b v),
and the joint creeps. Above it the joint slides. What an unlimited constraint would exert tells which of the two it is,
and by how much.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np

from massid.model.layout import JointLayout
from massid.typing import FloatArray, IntArray
from massid.walk.noise import SensorNoise

_HOLD_STEPS = 10
"""Samples for which the effect of noise is kept: it changes as slowly as the posture."""


@dataclass(frozen=True)
class Demand:
    """Friction along a motion.

    Attributes:
        torque: that acted, shape (n, n_joints) [N m].
        needed: to hold the joint; the same up to the friction loss, shape (n, n_joints) [N m].
        std: standard deviation of what is needed, from the noise of velocities, torques and wrenches, shape
            (n, n_joints) [N m].
    """

    torque: FloatArray
    needed: FloatArray
    std: FloatArray


class FrictionSolver:
    """Solves for the friction of an identification model.

    Args:
        model: with its friction loss; this object keeps it, and what is written to it counts.
        layout: addresses of the one-axis joints.
        noise: of the sensors.
    """

    def __init__(self, model: mujoco.MjModel, layout: JointLayout, noise: SensorNoise) -> None:
        self._model = model
        self._data = mujoco.MjData(model)
        self._joint_dof = layout.joint_dof
        self._n_tendons = int(np.count_nonzero(model.tendon_frictionloss > 0.0))
        self._effort_variance, self._velocity_variance = noise.effort**2, noise.joint_velocity**2
        self._wrench_variance = np.tile(noise.wrench_std() ** 2, model.nu // 6)

    def torque(self, qpos: FloatArray, qvel: FloatArray, force: FloatArray, wrench: FloatArray) -> FloatArray:
        """Friction that acted at every sample, shape (n, n_joints) [N m]; zero where a joint has no friction loss.

        Args:
            qpos: shape (n, nq) [rad or m].
            qvel: shape (n, nv) [rad/s or m/s].
            force: generalised forces of the joint torques, shape (n, nv) [N m or N].
            wrench: shape (n, 6 n_contacts) [N, N m].
        """
        data, torque = self._data, np.zeros((len(qpos), self._model.nv))
        for k in self._solutions(qpos, qvel, force, wrench):
            rows = self._rows
            torque[k, data.efc_id[rows]] = data.efc_force[rows]
        return torque[:, self._joint_dof]

    def solve(self, qpos: FloatArray, qvel: FloatArray, force: FloatArray, wrench: FloatArray, averaged: int) -> Demand:
        """Friction that acted, and what it would have taken to hold the joint; arguments as of `torque`.

        Args:
            qpos: positions.
            qvel: velocities.
            force: of the joint torques.
            wrench: at the contacts.
            averaged: how many readings each of velocities, forces and wrenches is the average of.
        """
        data, loss = self._data, self._model.dof_frictionloss
        torque, needed, std = np.zeros((3, len(qpos), self._model.nv))
        for k in self._solutions(qpos, qvel, force, wrench):
            rows = self._rows
            dofs, stiffness, (_, rate, impedance, _) = data.efc_id[rows], data.efc_D[rows], data.efc_KBIP[rows].T
            torque[k, dofs] = data.efc_force[rows]
            linear = -stiffness * (data.qacc[dofs] + rate * qvel[k, dofs])
            # A joint that is let go accelerates: what the constraint lacks is a share 1 - impedance of what it shows.
            beyond = (1.0 - impedance) * np.maximum(np.abs(linear) - loss[dofs], 0.0)
            needed[k, dofs] = torque[k, dofs] + np.sign(linear) * beyond
            if k % _HOLD_STEPS == 0:
                spread = np.sqrt(self._variance(dofs, stiffness, rate) / averaged)
            std[k, dofs] = spread
        return Demand(*(values[:, self._joint_dof] for values in (torque, needed, std)))

    def deviation(self, qpos: FloatArray, qvel: FloatArray, averaged: int) -> FloatArray:
        """Of what is needed at one state, see `Demand.std`, shape (n_joints,); inf without friction loss."""
        data, std = self._data, np.full(self._model.nv, np.inf)
        still = np.zeros((1, self._model.nv)), np.zeros((1, self._model.nu))
        for _ in self._solutions(qpos[None], qvel[None], *still):
            rows = self._rows
            variance = self._variance(data.efc_id[rows], data.efc_D[rows], data.efc_KBIP[rows].T[1])
            std[data.efc_id[rows]] = np.sqrt(variance / averaged)
        return std[self._joint_dof]

    def _solutions(self, qpos: FloatArray, qvel: FloatArray, force: FloatArray, wrench: FloatArray) -> Iterator[int]:
        """Solve sample after sample; its number, while the engine's data hold the solution."""
        model, data = self._model, self._data
        for k in range(len(qpos)):
            data.qpos[:], data.qvel[:], data.qfrc_applied[:], data.ctrl[:] = qpos[k], qvel[k], force[k], wrench[k]
            mujoco.mj_forward(model, data)
            yield k

    @property
    def _rows(self) -> slice:
        """Constraints of the last solution that are joints' friction: after equalities, before tendons' friction."""
        return slice(self._data.ne, self._data.ne + self._data.nf - self._n_tendons)

    def _variance(self, dofs: IntArray, stiffness: FloatArray, rate: FloatArray) -> FloatArray:
        """Of what is needed at the last solution, from single readings and with all joints held, shape (n_rows,)."""
        model, data = self._model, self._data
        held, moment = np.zeros((model.nv, model.nv)), np.zeros((model.nu, model.nv))
        mujoco.mj_fullM(model, data, held)
        mujoco.mju_sparse2dense(
            moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        )
        held[dofs, dofs] += stiffness
        by_force = -stiffness[:, None] * np.linalg.inv(held)[dofs]
        by_speed = -by_force[:, dofs] * (stiffness * rate) - np.diag(stiffness * rate)
        return np.asarray(
            (by_force[:, self._joint_dof] ** 2).sum(axis=1) * self._effort_variance
            + (by_force @ moment.T) ** 2 @ self._wrench_variance
            + (by_speed**2).sum(axis=1) * self._velocity_variance
        )
