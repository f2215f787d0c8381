"""Inverse dynamics of a motion and its derivatives by the unknowns: the rows of a linear regression.

The generalised force that no sensor accounts for is H(q) qdd + C(q, qd) - tau - sum_i J_i(q)^T f_i, with friction,
damping and armature in C. It is exactly linear in masses (whose links' inertias scale with them) and in the slow errors
of torque and wrench sensors, and zero for the true ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massid.compare.motion import Motion
from massid.errors import BadInputError
from massid.model.inverse import DiscreteInverseDynamics
from massid.model.robot import Robot
from massid.search.parameters import Kind, Parameter, ParameterSpace
from massid.typing import FloatArray

MASS_STEP = 0.1
"""Difference of masses, relative; the forces are linear in them but for the softness of friction."""
SHAPE_STEP = 1e-5
"""Difference of other numbers that change bodies, relative to their scales; the forces bend in most of them."""
ANGLE_STEP = 1e-4
"""Difference of joint positions [rad]."""
_READINGS = (Kind.EFFORT_OFFSET, Kind.EFFORT_GAIN, Kind.WRENCH_OFFSET, Kind.WRENCH_GAIN)


class InverseDynamics:
    """Unexplained forces of one robot, and what the unknowns would change about them.

    Args:
        robot: with nominal masses.
        space: masses and slow errors of sensors.
        contact_bodies: in the order of the motion's wrenches.
        timestep_s: sample period [s]; accelerations are differences over it.

    Raises:
        BadInputError: a parameter is of another kind.
        ModelError: a contact body is not in the model.
    """

    def __init__(self, robot: Robot, space: ParameterSpace, contact_bodies: Sequence[str], timestep_s: float) -> None:
        self._robot, self._space, self._contact_bodies = robot, space, tuple(contact_bodies)
        unknown = [parameter.name for parameter in space.parameters if parameter.kind is Kind.COEFFICIENT]
        if unknown:
            raise BadInputError(f"Inverse dynamics has no {', '.join(unknown)}: only masses and sensors' slow errors.")
        self._timestep_s = timestep_s
        self._model = self._model_at(space.nominal)

    def residual(self, motion: Motion) -> FloatArray:
        """Force that nothing explains at nominal values, shape (n, nv)."""
        applied = self._jacobians(motion)
        unexplained = self._forces(self._model, motion) - np.einsum("kvw,kw->kv", applied, motion.wrench)
        unexplained[:, self._robot.layout.joint_dof] -= motion.effort
        for parameter in self._space.parameters:
            if parameter.nominal and parameter.kind in _READINGS:  # as of a force sensor that was seen in the air
                unexplained += parameter.nominal * self._of_reading(parameter, motion, applied)
        return np.asarray(unexplained)

    def residual_at(self, motion: Motion, point: FloatArray) -> FloatArray:
        """The same at other values: exactly for bodies and joints, to first order for sensors, shape (n, nv)."""
        in_model = np.array([p.is_inertial or p.is_passive for p in self._space.parameters])
        change = np.where(in_model, 0.0, point - self._space.nominal)
        model = self._model_at(np.where(in_model, point, self._space.nominal))
        bodies = self._forces(model, motion) - self._forces(self._model, motion)
        return np.asarray(self.residual(motion) + bodies + self.regressor(motion) @ change)

    def regressor(self, motion: Motion) -> FloatArray:
        """Derivatives of the residual by the parameters, shape (n, nv, n_p)."""
        nominal = self._forces(self._model, motion)
        applied = self._jacobians(motion)
        out = np.empty((*nominal.shape, len(self._space)))
        for column, parameter in enumerate(self._space.parameters):
            if parameter.is_inertial or parameter.is_passive:
                step = MASS_STEP * parameter.nominal if parameter.kind is Kind.MASS else SHAPE_STEP * parameter.scale
                point = self._space.nominal.copy()
                point[column] += step
                out[:, :, column] = (self._forces(self._model_at(point), motion) - nominal) / step
            elif parameter.kind is Kind.EFFORT_LAG:
                out[:, :, column] = 0.0
                out[:, self._robot.layout.joint_dof, column] = -motion.effort_rate  # what acts is what is read later
            elif parameter.kind is Kind.WRENCH_LAG:
                out[:, :, column] = -np.einsum("kvw,kw->kv", applied, motion.wrench_rate)
            elif parameter.kind is Kind.ENCODER_OFFSET:
                out[:, :, column] = self._of_encoder(parameter, motion, nominal, applied)
            else:
                out[:, :, column] = self._of_reading(parameter, motion, applied)
        return out

    def _of_reading(self, parameter: Parameter, motion: Motion, applied: FloatArray) -> FloatArray:
        """Forces that a torque or wrench sensor shows too much, per unit of its offset or gain, shape (n, nv)."""
        source = self._robot.sensor_column(parameter, self._contact_bodies)
        if parameter.kind in (Kind.WRENCH_OFFSET, Kind.WRENCH_GAIN):
            per_unit, readings = applied[:, :, source], motion.wrench[:, source]
        else:
            per_unit = np.zeros(motion.qvel.shape)
            per_unit[:, self._robot.layout.joint_dof[source]] = 1.0
            readings = motion.effort[:, source]
        if parameter.kind in (Kind.EFFORT_GAIN, Kind.WRENCH_GAIN):
            return np.asarray(per_unit * readings[:, None])
        return np.asarray(per_unit)

    def _of_encoder(self, parameter: Parameter, motion: Motion, nominal: FloatArray, applied: FloatArray) -> FloatArray:
        """The true position is the reading less the offset, shape (n, nv)."""
        qpos = motion.qpos.copy()
        qpos[:, self._robot.layout.joint_qpos[self._robot.sensor_column(parameter, ())]] -= ANGLE_STEP
        moved = replace(motion, qpos=qpos)
        change = self._forces(self._model, moved) - nominal
        change -= np.einsum("kvw,kw->kv", self._jacobians(moved) - applied, motion.wrench)
        return np.asarray(change / ANGLE_STEP)

    def _model_at(self, point: FloatArray) -> DiscreteInverseDynamics:
        realisation = self._robot.realise(self._space, point, self._contact_bodies)
        return DiscreteInverseDynamics.of(self._robot, self._contact_bodies, self._timestep_s, realisation)

    @staticmethod
    def _forces(model: DiscreteInverseDynamics, motion: Motion) -> FloatArray:
        """Generalised forces that the motion takes, shape (n, nv)."""
        return model.forces(motion.qpos, motion.qvel, motion.qacc)

    def _jacobians(self, motion: Motion) -> FloatArray:
        """Generalised force per unit of each wrench reading, shape (n, nv, 6 n_contacts)."""
        jacobian = self._model.jacobian(motion.qpos)
        return np.asarray(jacobian.reshape(len(motion), -1, jacobian.shape[-1]).transpose(0, 2, 1))
