"""One unknown of every kind on the small biped, and some of a user's own that the package does not know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from massid.model.draft import Draft
from massid.model.layout import Channels
from massid.model.motion import Motion
from massid.model.robot import Robot
from massid.model.unknowns.lags import EffortLag, WrenchLag
from massid.model.unknowns.spaces import ask
from massid.model.unknowns.unknown import KINDS, Effect, Unknown, nuisance
from massid.typing import FloatArray

NAMED = (
    "mass/l_calf",
    "mass/torso",
    "com/torso/x",
    "inertia/l_thigh/xx",
    "inertia/torso/yz",
    "inertia_scale/torso",
    "inertia_scale/l_calf",
    "payload/l_calf@0.1,0,-0.2",
    "friction/r_hip_pitch",
    "damping/l_knee",
    "stiffness/r_ankle",
    "armature/l_knee",
    "effort_offset/r_knee",
    "effort_gain/l_hip_pitch",
    "encoder_offset/l_knee",
    "wrench_offset/l_foot/2",
    "wrench_offset/r_foot/4",
    "wrench_gain/r_foot/2",
    "effort_scale/all",
    "wrench_scale/all",
)
"""Names of unknowns that can be asked for."""
LAGS = (EffortLag(**nuisance(5e-4)), WrenchLag(**nuisance(5e-4)))
"""Unknowns that cannot."""


@dataclass(frozen=True)
class CommonGain(Unknown):
    """Relative error of all torque sensors alike, as of a wrong torque constant in a driver that they share."""

    kind = "shared_gain"
    title = "common gain of the torque sensors"
    per_walk = True

    @classmethod
    def ask(cls, robot: Robot, target: str) -> list[CommonGain]:
        return [cls(nominal=0.0, lower=-0.5, upper=0.5, scale=0.05)]

    def write(self, draft: Draft, values: FloatArray) -> None:
        draft.sensors.effort_gain[:] += values[:, None]

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        return Effect(force=-motion.effort)


@dataclass(frozen=True)
class TwinMass(Unknown):
    """Mass of two links that were made alike."""

    kind = "twin_mass"
    title = "masses of twins"
    unit = "kg"
    adds_mass: ClassVar[float] = 2.0
    left: str
    right: str

    def write(self, draft: Draft, values: FloatArray) -> None:
        for body in (self.left, self.right):
            draft.body(body).mass[:] = values


@dataclass(frozen=True)
class GyroscopeBias(Unknown):
    """What one axis of the base's gyroscope reads too much."""

    kind = "gyroscope_bias"
    title = "biases of the gyroscope"
    unit = "rad/s"
    per_walk = True
    axis: int

    def _column(self, channels: Channels) -> int:
        return channels.model.nv + channels.layout.root_dof + 3 + self.axis

    def write(self, draft: Draft, values: FloatArray) -> None:
        draft.sensors.state_offset[:, self._column(draft.channels)] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        measured = np.zeros(2 * channels.model.nv)
        measured[self._column(channels)] = 1.0
        return Effect(measured=measured)


COMMON_GAIN = CommonGain(nominal=0.0, lower=-0.5, upper=0.5, scale=0.05)
TWIN_CALVES = TwinMass("l_calf", "r_calf", nominal=2.5, lower=0.75, upper=6.25, scale=2.5)
YAW_BIAS = GyroscopeBias(2, nominal=0.0, lower=-0.5, upper=0.5, scale=0.02)
OWN = (COMMON_GAIN, TWIN_CALVES, YAW_BIAS)
"""A user's own: of sensors, of bodies, of a measured state."""


def examples(robot: Robot) -> list[Unknown]:
    """All of them."""
    return [*(unknown for name in NAMED for unknown in ask(robot, name)), *LAGS, *OWN]


def package_kinds() -> set[str]:
    """The kinds that massid itself brings."""
    return {kind for kind, cls in KINDS.items() if cls.__module__.startswith("massid.")}
