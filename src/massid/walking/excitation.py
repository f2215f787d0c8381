"""Motions beyond walking that make the links' masses visible: arms, torso and height follow slow sinusoids."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.typing import FloatArray
from massid.walking.gait import REFERENCE_LEG_M, Gait
from massid.walking.morphology import Morphology

_RAMP_S = 2.0
_SLOWEST_HZ, _FASTEST_HZ = 0.25, 0.7
_RANGE_SHARE = 0.4


@dataclass(frozen=True)
class Reference:
    """A reference with its rates, each of the same shape."""

    value: FloatArray
    rate: FloatArray
    acceleration: FloatArray


class Oscillation:
    """Independent sinusoids that start gently.

    Args:
        amplitude: of each channel, shape (n,).
        rng: draws frequencies and phases.
    """

    def __init__(self, amplitude: FloatArray, rng: np.random.Generator) -> None:
        self._amplitude = amplitude
        self._omega = 2 * np.pi * rng.uniform(_SLOWEST_HZ, _FASTEST_HZ, size=amplitude.shape)
        self._phase = rng.uniform(0.0, 2 * np.pi, size=amplitude.shape)

    def at(self, time_s: float) -> Reference:
        """Reference at time_s [s] after the start; channel n of the arrays has shape (n,)."""
        ramp = min(max(time_s / _RAMP_S, 0.0), 1.0)
        amplitude = ramp * ramp * (3 - 2 * ramp) * self._amplitude
        angle = self._omega * time_s + self._phase
        value = amplitude * np.sin(angle)
        rate = amplitude * self._omega * np.cos(angle)
        return Reference(value=value, rate=rate, acceleration=-(self._omega**2) * value)


class Excitation:
    """The sinusoids of one walk.

    Args:
        gait: amplitudes.
        model: robot, for its joint ranges.
        morphology: its parts.
        rng: draws frequencies and phases.
    """

    def __init__(self, gait: Gait, model: mujoco.MjModel, morphology: Morphology, rng: np.random.Generator) -> None:
        rooms = np.array([_room(model, int(dof)) for dof in morphology.arm_dofs])
        self._arms = Oscillation(np.minimum(gait.arm_rad, _RANGE_SHARE * rooms), rng)
        self._torso = Oscillation(np.full(3, gait.torso_rad), rng)
        scale = morphology.leg_length_m / REFERENCE_LEG_M
        self._height = Oscillation(np.array([gait.height_m * scale]), rng)

    def arms(self, time_s: float) -> Reference:
        """Offsets of the arm joints from their rest pose [rad], shape (n_arm,)."""
        return self._arms.at(time_s)

    def torso(self, time_s: float) -> Reference:
        """Roll, pitch and yaw of the torso [rad], shape (3,)."""
        return self._torso.at(time_s)

    def height(self, time_s: float) -> Reference:
        """Offset of the centre of mass's height [m], shape (1,)."""
        return self._height.at(time_s)


def _room(model: mujoco.MjModel, dof: int) -> float:
    """Distance of a joint's rest position from its nearer limit, infinite without limits."""
    joint = model.dof_jntid[dof]
    if not model.jnt_limited[joint]:
        return float("inf")
    low, high = model.jnt_range[joint]
    rest = model.qpos0[model.jnt_qposadr[joint]]
    return float(max(0.0, min(rest - low, high - rest)))
