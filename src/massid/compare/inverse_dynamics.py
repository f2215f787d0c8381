"""Inverse dynamics of a motion and its derivatives by the unknowns: the rows of a linear regression.

The generalised force that no sensor accounts for is H(q) qdd + C(q, qd) - tau - sum_i J_i(q)^T f_i, with friction,
damping and armature in C. It is exactly linear in masses (whose links' inertias scale with them) and in the slow errors
of torque and wrench sensors, and zero for the true ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from massid.model.draft import alone
from massid.model.inverse import DiscreteInverseDynamics
from massid.model.motion import Motion
from massid.model.robot import Robot
from massid.model.unknowns.bodies import Mass
from massid.model.unknowns.unknown import Effect, Unknown, unknowns_of
from massid.search.parameters import ParameterSpace
from massid.typing import BoolArray, FloatArray

MASS_STEP = 0.1
"""Difference of masses, relative; the forces are linear in them but for the softness of friction."""
SHAPE_STEP = 1e-5
"""Difference of other numbers that change models, relative to their scales; the forces bend in most of them."""
STATE_STEP = 1e-4
"""Difference of measured states [rad, m, rad/s, m/s]."""
_LEAST_DIRECTION = 1e-6
"""Share of the largest effect of a wrench below which one has none."""


class InverseDynamics:
    """Unexplained forces of one robot, and what the unknowns would change about them.

    What changes the model is differenced, which is exact; errors of sensors go by what they say of their effects.

    Args:
        robot: with nominal masses.
        space: what is unknown of it and of its sensors.
        contact_bodies: in the order of the motion's wrenches.
        timestep_s: sample period [s]; accelerations are differences over it.

    Raises:
        BadInputError: a parameter is not an unknown of a robot.
        ModelError: a contact body is not in the model.
    """

    def __init__(self, robot: Robot, space: ParameterSpace, contact_bodies: Sequence[str], timestep_s: float) -> None:
        self._robot, self._space, self._contact_bodies = robot, space, tuple(contact_bodies)
        self._unknowns, self._channels = unknowns_of(space), robot.channels(contact_bodies)
        drafts = [alone(self._channels, unknown) for unknown in self._unknowns]
        self._in_model = np.array([draft.sensors_written is None for draft in drafts])
        self._timestep_s = timestep_s
        self._model = self._model_at(space.nominal)

    def residual(self, motion: Motion) -> FloatArray:
        """Force that nothing explains at nominal values, shape (n, nv)."""
        applied = self._jacobians(motion)
        nominal = self._forces(self._model, motion)
        unexplained = nominal - np.einsum("kvw,kw->kv", applied, motion.wrench) - motion.effort
        for unknown, in_model in zip(self._unknowns, self._in_model, strict=True):
            if unknown.nominal and not in_model:  # as of a force sensor that was seen in the air
                unexplained += unknown.nominal * self._of_sensor(unknown, motion, nominal, applied)
        return np.asarray(unexplained)

    def residual_at(self, motion: Motion, point: FloatArray) -> FloatArray:
        """The same at other values: exactly for bodies, joints and states, to first order for inputs, shape (n, nv)."""
        change = np.where(self._in_model, 0.0, point - self._space.nominal)
        model = self._model_at(np.where(self._in_model, point, self._space.nominal))
        applied, forces = self._jacobians(motion), self._forces(model, motion)
        out = self.residual(motion) + forces - self._forces(self._model, motion)
        error = np.zeros(2 * self._robot.model.nv)
        for column in np.flatnonzero(change):
            effect = self._unknowns[column].effect(motion, self._channels)
            out += change[column] * _of_inputs(effect, applied)
            if effect.measured is not None:
                error += change[column] * effect.measured
        if error.any():
            out += self._of_states(error, motion, model, forces, applied)
        return np.asarray(out)

    def beyond(self, forces: FloatArray, motion: Motion, unknown: BoolArray) -> FloatArray:
        """What no wrench explains of some forces, in least squares, shape (n, nv).

        Args:
            forces: generalised forces along a motion, shape (n, nv).
            motion: n instants.
            unknown: components of the wrenches that may be anything, shape (n, 6 n_c).
        """
        if not unknown.any():
            return forces
        pushed = np.where(unknown[:, None], self._jacobians(motion), 0.0)
        wrench = np.linalg.pinv(pushed, rcond=_LEAST_DIRECTION) @ forces[..., None]
        return np.asarray(forces - (pushed @ wrench)[..., 0])

    def regressor(self, motion: Motion) -> FloatArray:
        """Derivatives of the residual by the unknowns, shape (n, nv, n_p)."""
        nominal = self._forces(self._model, motion)
        applied = self._jacobians(motion)
        out = np.empty((*nominal.shape, len(self._space)))
        for column, unknown in enumerate(self._unknowns):
            if self._in_model[column]:
                step = MASS_STEP * unknown.nominal if isinstance(unknown, Mass) else SHAPE_STEP * unknown.scale
                point = self._space.nominal.copy()
                point[column] += step
                out[:, :, column] = (self._forces(self._model_at(point), motion) - nominal) / step
            else:
                out[:, :, column] = self._of_sensor(unknown, motion, nominal, applied)
        return out

    def _of_sensor(self, unknown: Unknown, motion: Motion, nominal: FloatArray, applied: FloatArray) -> FloatArray:
        """Forces that a sensor leaves unexplained per unit of its error, shape (n, nv)."""
        effect = unknown.effect(motion, self._channels)
        out = _of_inputs(effect, applied)
        if effect.measured is not None:
            small = STATE_STEP * effect.measured
            out = out + self._of_states(small, motion, self._model, nominal, applied) / STATE_STEP
        return np.asarray(out)

    def _of_states(
        self,
        error: FloatArray,
        motion: Motion,
        model: DiscreteInverseDynamics,
        forces: FloatArray,
        applied: FloatArray,
    ) -> FloatArray:
        """Forces that an error of the readings of states, shape (2 nv,), leaves unexplained, shape (n, nv)."""
        true = self._moved(motion, -error)
        change = self._forces(model, true) - forces
        return np.asarray(change - np.einsum("kvw,kw->kv", self._jacobians(true) - applied, motion.wrench))

    def _moved(self, motion: Motion, change: FloatArray) -> Motion:
        """The motion with every state moved along a tangent vector, shape (2 nv,)."""
        model, position = self._robot.model, motion.position.copy()
        for row in position:
            mujoco.mj_integratePos(model, row, change[: model.nv], 1.0)
        return replace(motion, position=position, velocity=motion.velocity + change[model.nv :])

    def _model_at(self, point: FloatArray) -> DiscreteInverseDynamics:
        realisation = self._robot.realise(self._space, point, self._contact_bodies)
        return DiscreteInverseDynamics.of(self._robot, self._contact_bodies, self._timestep_s, realisation)

    @staticmethod
    def _forces(model: DiscreteInverseDynamics, motion: Motion) -> FloatArray:
        """Generalised forces that the motion takes, shape (n, nv)."""
        return model.forces(motion.position, motion.velocity, motion.acceleration)

    def _jacobians(self, motion: Motion) -> FloatArray:
        """Generalised force per unit of each wrench reading, shape (n, nv, 6 n_contacts)."""
        jacobian = self._model.jacobian(motion.position)
        return np.asarray(jacobian.reshape(len(motion), -1, jacobian.shape[-1]).transpose(0, 2, 1))


def _of_inputs(effect: Effect, applied: FloatArray) -> FloatArray:
    """Forces that an error of torques and wrenches leaves unexplained, shape (n, nv), or 0."""
    out: FloatArray = np.zeros(())
    if effect.force is not None:
        out = out - effect.force
    if effect.wrench is not None:
        out = out - np.einsum("kvw,kw->kv", applied, effect.wrench)
    return out
