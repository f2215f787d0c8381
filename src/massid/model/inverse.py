"""Inverse dynamics of recorded steps: what must have acted, by the rule of the robot's integrator, and contacts in it.

A log is made of steps: states before and after, and inputs that were held in between. Its inverse dynamics are those of
the step, not of the equation of motion, from which an integrator that takes damping implicitly departs by h B a.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import TypeAlias

import mujoco
import numpy as np

from massid.model.layout import JointLayout
from massid.model.realisation import Realisation, write_fields
from massid.model.robot import Robot
from massid.typing import FloatArray, IntArray
from massid.walk import Walk

_LEAST_DIRECTION = 1e-9

Steps: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""Positions and velocities at which steps begin, and the mean accelerations over them, in the model's order; shapes
(n, nq), (n, nv) and (n, nv)."""


def takes_stages(model: mujoco.MjModel) -> bool:
    """Whether a step evaluates forces several times, so that no single torque and wrench makes it."""
    return int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)


def with_single_stage(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model whose step the engine can invert and linearise: the rule for every integrator.

    Euler, implicit, implicitfast and discrete stay as they are. RK4 becomes Euler: neither mjENBL_INVDISCRETE nor
    mjd_transitionFD knows it, and its four stages have no single force to be found. What a step takes is then off by
    what forces and accelerations change in half a step, of order h. In the middle of the step it would be of order h^2
    if inputs were held, but the wrench of a simulated contact is that of the first stage: on such logs the force that
    stayed unexplained was a quarter larger.

    With its dampers off Euler is explicit in the engine's step; its inverse has to be told.
    """
    single = copy.copy(model)
    if takes_stages(single):
        single.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    if single.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_DAMPER:
        single.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    return single


def damping_is_implicit(model: mujoco.MjModel) -> bool:
    """Whether a single-stage step solves for the acceleration with H + h B instead of H."""
    disabled = mujoco.mjtDisableBit.mjDSBL_DAMPER
    if int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_EULER):
        disabled |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
    return not model.opt.disableflags & disabled


def invertible(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy of a model whose `mj_inverse` undoes its `mj_step` (Euler's, for RK4)."""
    single = with_single_stage(model)
    single.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_INVDISCRETE)
    return single


def recorded_steps(walk: Walk, layout: JointLayout, rows: IntArray) -> Steps:
    """Steps of a walk that begin at some of its samples, each of which must have another one after it.

    Args:
        walk: aligned with the robot.
        layout: addresses in the model.
        rows: samples, shape (n,).
    """
    qpos, qvel = layout.to_qpos(walk.qpos[rows]), layout.to_qvel(walk.qvel[rows])
    return qpos, qvel, (layout.to_qvel(walk.qvel[rows + 1]) - qvel) / walk.timestep_s


class DiscreteInverseDynamics:
    """What steps of an identification model took; for RK4 see `with_single_stage`.

    Args:
        model: with any masses and the sample period as its time step. It is not written to.
        contact_bodies: bodies with a wrench.
    """

    def __init__(self, model: mujoco.MjModel, contact_bodies: Sequence[str] = ()) -> None:
        self._model = invertible(model)
        self._data = mujoco.MjData(self._model)
        self._bodies = [self._model.body(name).id for name in contact_bodies]

    @classmethod
    def of(
        cls, robot: Robot, contact_bodies: Sequence[str], timestep_s: float, realisation: Realisation | None = None
    ) -> DiscreteInverseDynamics:
        """Those of a robot with its nominal parameters, or with the first of a realisation's.

        Raises:
            ModelError: a contact body is not in the model.
        """
        model = robot.identification_model(contact_bodies)
        model.opt.timestep = timestep_s
        if realisation is not None:
            write_fields(model, realisation)
        return cls(model, contact_bodies)

    def forces(self, qpos: FloatArray, qvel: FloatArray, qacc: FloatArray) -> FloatArray:
        """Generalised forces that made steps, contacts and torques together, shape (n, nv) [N, N m].

        Args:
            qpos: positions before each step, shape (n, nq).
            qvel: velocities before it, shape (n, nv).
            qacc: change of velocity over it, divided by the time step, shape (n, nv).
        """
        model, data = self._model, self._data
        out = np.empty(qvel.shape)
        for k in range(len(out)):
            data.qpos[:], data.qvel[:], data.qacc[:] = qpos[k], qvel[k], qacc[k]
            mujoco.mj_inverse(model, data)
            out[k] = data.qfrc_inverse
        return out

    def inertia(self, qpos: FloatArray) -> FloatArray:
        """Mass matrices, shape (n, nv, nv).

        Args:
            qpos: positions, shape (n, nq).
        """
        model, data = self._model, self._data
        out = np.empty((len(qpos), model.nv, model.nv))
        for k, row in enumerate(qpos):
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)
            mujoco.mj_fullM(model, data, out[k])
        return out

    def jacobian(self, qpos: FloatArray) -> FloatArray:
        """Generalised force per unit of force and moment in each contact body's frame, shape (n, n_c, 6, nv).

        Args:
            qpos: positions, shape (n, nq).
        """
        model, data = self._model, self._data
        out = np.empty((len(qpos), len(self._bodies), 6, model.nv))
        full = np.empty((6, model.nv))
        for k, row in enumerate(qpos):
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            for c, body in enumerate(self._bodies):
                mujoco.mj_jacBody(model, data, full[:3], full[3:], body)
                to_body = data.xmat[body].reshape(3, 3).T
                out[k, c, :3], out[k, c, 3:] = to_body @ full[:3], to_body @ full[3:]
        return out


def applied(jacobian: FloatArray, wrench: FloatArray) -> FloatArray:
    """Generalised forces of contact wrenches, sum_i J_i^T f_i, shape (n, nv).

    Args:
        jacobian: from `DiscreteInverseDynamics.jacobian`, shape (n, n_c, 6, nv).
        wrench: in the bodies' frames, shape (n, n_c, 6).
    """
    return np.asarray(np.einsum("kciv,kci->kv", jacobian, wrench))


def closed_directions(model: mujoco.MjModel, qpos: FloatArray) -> FloatArray:
    """Orthonormal generalised forces that equality constraints can exert, shape (n, nv, m), zeros where fewer can."""
    model = copy.copy(model)
    model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    data = mujoco.MjData(model)
    out = np.zeros((len(qpos), model.nv, model.nv))
    widest = 0
    for k, row in enumerate(qpos):
        data.qpos[:] = row
        mujoco.mj_fwdPosition(model, data)
        rows = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        jacobian = data.efc_J.reshape(-1, model.nv)[rows]
        _, values, directions = np.linalg.svd(jacobian, full_matrices=False)
        rank = int((values > _LEAST_DIRECTION * values.max(initial=0.0)).sum())
        out[k, :, :rank] = directions[:rank].T
        widest = max(widest, rank)
    return out[:, :, :widest]
