"""What the ground must have exerted where no sensor says so: the wrenches that a motion and its torques ask for.

Of the generalised force that inverse dynamics finds, joint torques and measured wrenches supply a part. What is left is
the work of the wrenches that were not measured: six equations of the base and one of each joint for six unknowns a
foot. They are solved in the least squares of what is uncertain of them, accelerations and torques.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from massid.model.inverse import DiscreteInverseDynamics, applied, closed_directions
from massid.model.realisation import Realisation, write_fields
from massid.model.robot import Robot
from massid.typing import BoolArray, FloatArray

_LEAST_DIRECTION = 1e-8
"""Wrenches that move nothing, to this share of those that move most, as of a straight leg, are taken to be zero."""
_FOOT_M = 0.1
"""What a force on a foot is multiplied by for a moment of like size [m]."""


@dataclass(frozen=True)
class Supplied:
    """Motion and forces of n steps, in the model's order.

    Attributes:
        position: shape (n, nq) [rad or m].
        velocity: shape (n, nv) [rad/s or m/s].
        acceleration: mean over each step, shape (n, nv) [rad/s^2 or m/s^2].
        effort: joint torques as generalised forces, zero at the base, shape (n, nv) [N m or N].
        wrench: what was measured, in the contact bodies' frames, shape (n, n_c, 6) [N, N m].
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    effort: FloatArray
    wrench: FloatArray


@dataclass(frozen=True)
class Asked:
    """Wrenches as a motion asks for them.

    Attributes:
        wrench: in the contact bodies' frames, shape (n, n_c, 6) [N, N m].
        spread: a root of their covariance, zero without noise, shape (n, n_c, 6, m).
    """

    wrench: FloatArray
    spread: FloatArray


class GroundDemand:
    """Solves for wrenches that were not measured.

    Args:
        robot: the robot.
        contact_bodies: bodies with a wrench.
        timestep_s: sample period [s].
        acceleration_std: how uncertain accelerations are, shape (nv,) [rad/s^2 or m/s^2].
        effort_std: how uncertain joint torques are [N m].
        exact: whether these are but weights, for there is no noise. Otherwise wrenches are believed beforehand to be
            about as large as the robot's weight, which matters where motion tells little of them, as between the feet
            of legs with few joints.
        realisation: parameters of the robot; default the nominal ones.

    Raises:
        ModelError: a contact body is not in the model.
    """

    def __init__(
        self,
        robot: Robot,
        contact_bodies: Sequence[str],
        timestep_s: float,
        acceleration_std: FloatArray,
        effort_std: float,
        realisation: Realisation | None = None,
        *,
        exact: bool = False,
    ) -> None:
        model = robot.identification_model(contact_bodies)
        model.opt.timestep = timestep_s
        if realisation is not None:
            write_fields(model, realisation)
        self._looped = None
        if model.neq and not exact:  # through a stiff tie noise of positions is a force of any size
            self._looped = copy.copy(model)
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        self._dynamics = DiscreteInverseDynamics(model, contact_bodies)
        self._exact = exact
        weight = robot.total_mass_kg * (float(np.linalg.norm(robot.model.opt.gravity)) or 1.0)
        self._size = weight * np.repeat([1.0, _FOOT_M], 3)
        self._acceleration_std = acceleration_std
        self._effort_variance = np.zeros(robot.model.nv)
        # What holds a joint that sticks is anything up to its friction loss.
        friction = robot.model.dof_frictionloss[robot.layout.joint_dof]
        self._effort_variance[robot.layout.joint_dof] = effort_std**2 + friction**2

    def wrenches(self, given: Supplied, unknown: BoolArray) -> Asked:
        """Solve for wrenches; those that are measured stay as they are, and what is neither is zero.

        Args:
            given: what moved and what acted.
            unknown: components to be found, shape (n, n_c, 6).
        """
        known = np.where(unknown, 0.0, given.wrench)
        jacobian = self._dynamics.jacobian(given.position)
        missing = self._dynamics.forces(given.position, given.velocity, given.acceleration)
        missing -= given.effort + applied(jacobian, known)
        inertia = self._dynamics.inertia(given.position)
        by_acceleration = inertia * self._acceleration_std
        covariance = by_acceleration @ by_acceleration.transpose(0, 2, 1) + np.diag(self._effort_variance)
        factor = np.linalg.cholesky(covariance)
        sized = np.where(unknown[..., None], jacobian * self._size[:, None], 0.0)
        columns = sized.reshape(len(missing), -1, missing.shape[1])
        n_wrenches = columns.shape[1]
        if self._looped is not None:
            pushed = self._size[0] * closed_directions(self._looped, given.position).transpose(0, 2, 1)
            columns = np.concatenate([columns, pushed], axis=1)
        whitened = np.linalg.solve(factor, np.concatenate([columns, missing[:, None]], axis=1).transpose(0, 2, 1))
        # With more unknowns than equations there are as many directions all the same, of which some show in nothing.
        whitened = np.pad(whitened, ((0, 0), (0, max(0, columns.shape[1] - whitened.shape[1])), (0, 0)))
        left, values, right = np.linalg.svd(whitened[..., :-1], full_matrices=False)
        along = np.einsum("kvr,kv->kr", left, whitened[..., -1])
        if self._exact:
            sees = values > _LEAST_DIRECTION * values[:, :1]
            along, doubt = np.where(sees, along / np.where(sees, values, 1.0), 0.0), np.zeros_like(values)
        else:
            along, doubt = along * values / (1.0 + values**2), 1.0 / (1.0 + values**2)
        right = right[..., :n_wrenches]  # what closed loops exert is nobody's concern
        found = np.einsum("krw,kr->kw", right, along).reshape(known.shape) * self._size
        spread = np.tile(self._size, known.shape[1])[:, None] * right.transpose(0, 2, 1) * np.sqrt(doubt)[:, None]
        return Asked(
            np.where(unknown, found, known),
            np.where(unknown[..., None], spread.reshape(*known.shape, -1), 0.0),
        )
