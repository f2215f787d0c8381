"""The joint torque that acted over a step: what must be held over it so that a replay makes the same step."""

from __future__ import annotations

from typing import Protocol

import mujoco
import numpy as np

from massid.model.inverse import invertible
from massid.typing import FloatArray

_IMPLICIT = (int(mujoco.mjtIntegrator.mjINT_IMPLICIT), int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST))
_AFFINE_GAIN, _AFFINE_BIAS = int(mujoco.mjtGain.mjGAIN_AFFINE), int(mujoco.mjtBias.mjBIAS_AFFINE)
_CONTACT_ROWS = (
    int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS),
    int(mujoco.mjtConstraint.mjCNSTR_CONTACT_PYRAMIDAL),
    int(mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC),
)


class EffortMeter(Protocol):
    """Reads the torque of each degree of freedom that the actuators exerted over a step."""

    def before(self, data: mujoco.MjData) -> None:
        """Look at the state before the step."""

    def after(self, data: mujoco.MjData) -> FloatArray:
        """Generalised force over the step [N m or N], shape (nv,), from data in which `mj_step` has just ended."""


def effort_meter(model: mujoco.MjModel) -> EffortMeter:
    """Choose the meter: torques that do not depend on velocity, or are not taken implicitly, need no correction."""
    if int(model.opt.integrator) in _IMPLICIT and _depends_on_velocity(model):
        return StepEquivalentEffort(model)
    return ActuatorEffort()


class ActuatorEffort:
    """The torque at the beginning of the step, which acts all through it."""

    def before(self, data: mujoco.MjData) -> None:
        """Nothing to keep."""

    def after(self, data: mujoco.MjData) -> FloatArray:
        """The engine's own actuator torque."""
        torque: FloatArray = data.qfrc_actuator
        return torque


class StepEquivalentEffort:
    """The constant torque that makes the step which an implicit integrator made with velocity-dependent actuators.

    An implicit integrator takes tau + dtau/dv (v1 - v0). Discrete inverse dynamics of a copy without contacts and
    actuators gives everything that must have acted; contacts and outer forces are taken off.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        disabled = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
        self._full = model
        self._model = invertible(model)
        self._model.opt.disableflags |= int(disabled)
        self._data = mujoco.MjData(self._model)
        self._state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
        self._from_contacts = np.zeros(model.nv)

    def before(self, data: mujoco.MjData) -> None:
        """Keep the state."""
        mujoco.mj_getState(self._full, data, self._state, mujoco.mjtState.mjSTATE_INTEGRATION)

    def after(self, data: mujoco.MjData) -> FloatArray:
        """Inverse dynamics of the step, less contacts and outer forces."""
        model, replica = self._model, self._data
        mujoco.mj_setState(model, replica, self._state, mujoco.mjtState.mjSTATE_INTEGRATION)
        replica.qacc[:] = (data.qvel - replica.qvel) / model.opt.timestep
        mujoco.mj_inverse(model, replica)
        in_contact = np.isin(data.efc_type, _CONTACT_ROWS)
        self._from_contacts[:] = 0.0
        if in_contact.any():
            mujoco.mj_mulJacTVec(self._full, data, self._from_contacts, np.where(in_contact, data.efc_force, 0.0))
        outer = data.qfrc_smooth - data.qfrc_passive + data.qfrc_bias - data.qfrc_actuator
        torque: FloatArray = replica.qfrc_inverse - self._from_contacts - outer
        return torque


def _depends_on_velocity(model: mujoco.MjModel) -> bool:
    gain, bias = model.actuator_gaintype, model.actuator_biastype
    fixed_gain = gain == int(mujoco.mjtGain.mjGAIN_FIXED)
    no_bias = bias == int(mujoco.mjtBias.mjBIAS_NONE)
    steady_gain = fixed_gain | ((gain == _AFFINE_GAIN) & (model.actuator_gainprm[:, 2] == 0.0))
    steady_bias = no_bias | ((bias == _AFFINE_BIAS) & (model.actuator_biasprm[:, 2] == 0.0))
    return not bool(np.all(steady_gain & steady_bias))
