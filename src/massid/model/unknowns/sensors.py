"""Slow errors of sensors: what torque sensors, contact sensors and encoders read too much, constant within a walk.

A reading is (1 + gain) quantity + offset. The larger an offset or a gain, the smaller is what the same reading means.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from massid.errors import BadInputError, ModelError, unknown_name
from massid.model.layout import Channels
from massid.model.motion import Motion
from massid.model.unknowns.unknown import ALL, NUISANCE_REACH, Effect, Unknown
from massid.typing import FloatArray
from massid.walk.noise import PRESETS

if TYPE_CHECKING:
    from massid.model.draft import Draft
    from massid.model.robot import Robot

ORDINARY = PRESETS["realistic"]
"""Sensors whose errors are the typical ones where they are asked for."""
WRENCH_AXES = ("force x", "force y", "force z", "moment x", "moment y", "moment z")
FORCE_AXES = 3
"""Axes of a contact sensor that come before its moments."""
TYPICAL_SCALE = 0.1
"""A typical error that sensors share: a torque constant off by a tenth."""
LEVER_M = 0.1
"""A typical error of a moment is that of a force with this lever."""


@dataclass(frozen=True)
class JointSensorError(Unknown):
    """An error of a joint's sensor.

    Attributes:
        joint: its name.
        typical: size of such an error, in the unit of it.
    """

    per_walk = True
    typical: ClassVar[float]

    joint: str

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[JointSensorError]:
        """Of one joint.

        Raises:
            ModelError: no such joint.
        """
        robot.require_joint(target)
        reach = NUISANCE_REACH * cls.typical
        return (cls(target, nominal=0.0, lower=-reach, upper=reach, scale=cls.typical),)


@dataclass(frozen=True)
class EffortOffset(JointSensorError):
    """What a joint's torque sensor reads too much."""

    kind = "effort_offset"
    title = "torque offsets"
    unit = "N m"
    typical = ORDINARY.effort_offset

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of the joint's torque sensor."""
        draft.sensors.effort_offset[:, draft.channels.joint(self.joint)] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """One newton metre less."""
        return Effect.on_joint(channels, self.joint, -np.ones(len(motion)))


@dataclass(frozen=True)
class EffortGain(JointSensorError):
    """Relative error of a joint's torque sensor."""

    kind = "effort_gain"
    title = "torque gains"
    typical = ORDINARY.effort_gain

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of the joint's torque sensor."""
        draft.sensors.effort_gain[:, draft.channels.joint(self.joint)] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """The torque, once less."""
        return Effect.on_joint(channels, self.joint, -motion.effort[:, channels.dof(self.joint)])


@dataclass(frozen=True)
class EncoderOffset(JointSensorError):
    """What a joint's encoder reads too much."""

    kind = "encoder_offset"
    title = "encoder offsets"
    unit = "rad"
    typical = ORDINARY.joint_position_offset

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of the measured position."""
        draft.sensors.state_offset[:, draft.channels.dof(self.joint)] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """One radian more is measured; nothing acts."""
        measured = np.zeros(2 * channels.model.nv)
        measured[channels.dof(self.joint)] = 1.0
        return Effect(measured=measured)


@dataclass(frozen=True)
class ContactSensorError(Unknown):
    """An error of one axis of a contact sensor.

    Attributes:
        body: that the sensor is on.
        axis: 0-2 force, 3-5 moment.
        typical: size of such an error of a force, in its unit.
    """

    per_walk = True
    typical: ClassVar[float]

    body: str
    axis: int

    @property
    def label(self) -> str:
        """Such as "l_foot force x"."""
        return f"{self.body} {WRENCH_AXES[self.axis]}"

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[ContactSensorError]:
        """Of BODY, one an axis, or of BODY/AXIS with axes 0-2 of force and 3-5 of moment.

        Raises:
            ModelError: no such body.
            BadInputError: no such axis.
        """
        bodies = [robot.model.body(b).name for b in range(1, robot.model.nbody)]
        body, _, number = (target, "", "") if target in bodies else target.rpartition("/")
        if body not in bodies:
            raise ModelError(unknown_name("body", body or target, bodies, robot.source))
        if number and number not in [str(axis) for axis in range(len(WRENCH_AXES))]:
            raise BadInputError(f"{cls.kind}/{target}: a contact sensor has axes 0-2 (force) and 3-5 (moment).")
        found = []
        for axis in [int(number)] if number else range(len(WRENCH_AXES)):
            size = cls.typical_of(axis)
            reach = NUISANCE_REACH * size
            found.append(cls(body, axis, nominal=0.0, lower=-reach, upper=reach, scale=size))
        return found

    @classmethod
    def typical_of(cls, axis: int) -> float:
        """Size of such an error of an axis, in its unit."""
        return cls.typical


@dataclass(frozen=True)
class WrenchOffset(ContactSensorError):
    """What one axis of a contact sensor reads too much."""

    kind = "wrench_offset"
    title = "force offsets"
    typical = ORDINARY.force_offset

    @property
    def unit(self) -> str:
        """Of the axis."""
        return "N" if self.axis < FORCE_AXES else "N m"

    @classmethod
    def typical_of(cls, axis: int) -> float:
        """Of a moment as of a force with a short lever."""
        return cls.typical * (1.0 if axis < FORCE_AXES else LEVER_M)

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of the axis."""
        draft.sensors.wrench_offset[:, draft.channels.axis(self.body, self.axis)] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """One newton less, where the body is loaded."""
        return Effect.on_axis(channels, self.body, self.axis, -motion.loaded[:, channels.axis(self.body, self.axis)])


@dataclass(frozen=True)
class WrenchGain(ContactSensorError):
    """Relative error of one axis of a contact sensor."""

    kind = "wrench_gain"
    title = "wrench gains"
    typical = ORDINARY.wrench_gain

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of the axis."""
        draft.sensors.wrench_gain[:, draft.channels.axis(self.body, self.axis)] += values

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """The load, once less."""
        return Effect.on_axis(channels, self.body, self.axis, -motion.wrench[:, channels.axis(self.body, self.axis)])


@dataclass(frozen=True)
class SensorScale(Unknown):
    """Relative error that all sensors of a kind share, as of a torque constant or a calibration in common."""

    per_walk = True

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[SensorScale]:
        """Of all of them.

        Raises:
            BadInputError: another target.
        """
        if target != ALL:
            raise BadInputError(f"{cls.kind}/{target}: there is one for all sensors, `{cls.kind}/{ALL}`.")
        reach = NUISANCE_REACH * TYPICAL_SCALE
        return (cls(nominal=0.0, lower=-reach, upper=reach, scale=TYPICAL_SCALE),)


@dataclass(frozen=True)
class EffortScale(SensorScale):
    """Relative error of all torque sensors alike."""

    kind = "effort_scale"
    title = "scale of the torques"

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of every torque sensor."""
        draft.sensors.effort_gain[:] += values[:, None]

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """All torques, once less."""
        return Effect(force=-motion.effort)


@dataclass(frozen=True)
class WrenchScale(SensorScale):
    """Relative error of all contact sensors alike."""

    kind = "wrench_scale"
    title = "scale of the wrenches"

    def write(self, draft: Draft, values: FloatArray) -> None:
        """As an error of every contact sensor."""
        draft.sensors.wrench_gain[:] += values[:, None]

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """All loads, once less."""
        return Effect(wrench=-motion.wrench)
