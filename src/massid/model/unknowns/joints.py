"""Unknowns of joints: dry friction, viscous damping and springs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.model.layout import Channels
from massid.model.motion import Motion
from massid.model.unknowns.unknown import Effect, Unknown
from massid.typing import FloatArray

if TYPE_CHECKING:
    from massid.model.draft import Draft
    from massid.model.robot import Robot

TYPICAL_LEVER_M = 0.002
"""A typical friction torque is the robot's weight with this lever: 3 N m for 150 kg, 0.7 N m for 35 kg."""
TYPICAL_SPEED = 1.0
"""A typical damping makes that torque at this joint speed [rad/s]."""
TYPICAL_ANGLE = 0.3
"""A typical spring makes that torque at this distance from its reference [rad]."""
ARMATURE_PER_KG = 0.02 / 35.0
"""Typical rotor inertia, for the robot's mass [m^2]; those of G1, T1 and H1 are 0.003 to 0.1 kg m^2."""
REACH = 30.0
"""Theta ends at so many typical values above the model file's."""


@dataclass(frozen=True)
class JointUnknown(Unknown):
    """A torque of a joint that no motor makes, as a field of the model by degree of freedom; from zero up.

    Attributes:
        joint: its name.
        field: of MjModel.
        typical: torque that a unit of it typically makes, in typical friction torques.
    """

    field: ClassVar[str]
    typical: ClassVar[float] = 1.0

    joint: str

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[JointUnknown]:
        """Of one joint.

        Raises:
            ModelError: no such joint, or actuators that damp joints, too.
        """
        _check_joint(robot, target)
        nominal = float(getattr(robot.model, cls.field)[robot.model.joint(target).dofadr[0]])
        scale = max(nominal, _typical_torque(robot) / cls.typical)
        return (cls(target, nominal=nominal, lower=0.0, upper=nominal + REACH * scale, scale=scale),)

    def write(self, draft: Draft, values: FloatArray) -> None:
        """Into the field."""
        draft.field(self.field)[:, draft.channels.dof(self.joint)] = values


@dataclass(frozen=True)
class FrictionLoss(JointUnknown):
    """Friction loss of a joint."""

    kind = "friction"
    title = "friction losses"
    unit = "N m"
    field = "dof_frictionloss"

    def write_spec(self, spec: mujoco.MjSpec, value: float) -> None:
        """As the joint's own."""
        spec.joint(self.joint).frictionloss = value

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """A torque in the direction of friction, where a joint is known to slide."""
        return Effect.on_joint(channels, self.joint, motion.sliding[:, channels.dof(self.joint)])


@dataclass(frozen=True)
class Damping(JointUnknown):
    """Viscous damping of a joint."""

    kind = "damping"
    title = "dampings"
    unit = "N m s/rad"
    field = "dof_damping"
    typical = TYPICAL_SPEED

    def write_spec(self, spec: mujoco.MjSpec, value: float) -> None:
        """As the joint's own; terms of higher order stay."""
        joint = spec.joint(self.joint)
        joint.damping = np.array([value, *joint.damping[1:]])

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """A torque against the velocity."""
        return Effect.on_joint(channels, self.joint, -motion.velocity[:, channels.dof(self.joint)])


@dataclass(frozen=True)
class Armature(Unknown):
    """Rotor inertia of a joint's drive, as seen at the joint; a URDF has none, and many a model file neither."""

    kind = "armature"
    title = "rotor inertias"
    unit = "kg m^2"

    joint: str

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[Armature]:
        """Of one joint, from zero up.

        Raises:
            ModelError: no such joint.
        """
        robot.require_joint(target)
        nominal = float(robot.model.dof_armature[robot.model.joint(target).dofadr[0]])
        scale = max(nominal, typical_armature(robot))
        return (cls(target, nominal=nominal, lower=0.0, upper=nominal + REACH * scale, scale=scale),)

    def write(self, draft: Draft, values: FloatArray) -> None:
        """Into the joint."""
        draft.field("dof_armature")[:, draft.channels.dof(self.joint)] = values

    def write_spec(self, spec: mujoco.MjSpec, value: float) -> None:
        """As the joint's own."""
        spec.joint(self.joint).armature = value

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """The torque that it takes to turn the rotor."""
        return Effect.on_joint(channels, self.joint, -motion.acceleration[:, channels.dof(self.joint)])


def typical_armature(robot: Robot) -> float:
    """Of a joint of a robot of that weight [kg m^2]: 0.02 in one of 35 kg."""
    return ARMATURE_PER_KG * robot.total_mass_kg


@dataclass(frozen=True)
class Stiffness(Unknown):
    """Stiffness of a joint's spring, about the reference position that the model gives it.

    Attributes:
        joint: its name.
    """

    kind = "stiffness"
    title = "stiffnesses"
    unit = "N m/rad"

    joint: str

    @classmethod
    def ask(cls, robot: Robot, target: str) -> Sequence[Stiffness]:
        """Of one joint, from zero up.

        Raises:
            ModelError: no such joint.
        """
        robot.require_joint(target)
        nominal = float(robot.model.jnt_stiffness[robot.model.joint(target).id])
        scale = max(nominal, _typical_torque(robot) / TYPICAL_ANGLE)
        return (cls(target, nominal=nominal, lower=0.0, upper=nominal + REACH * scale, scale=scale),)

    def write(self, draft: Draft, values: FloatArray) -> None:
        """Into the joint."""
        draft.field("jnt_stiffness")[:, draft.channels.model.joint(self.joint).id] = values

    def write_spec(self, spec: mujoco.MjSpec, value: float) -> None:
        """As the joint's own; terms of higher order stay."""
        joint = spec.joint(self.joint)
        joint.stiffness = np.array([value, *joint.stiffness[1:]])

    def effect(self, motion: Motion, channels: Channels) -> Effect:
        """A torque towards the reference position."""
        address = channels.layout.joint_qpos[channels.joint(self.joint)]
        away = motion.position[:, address] - channels.model.qpos_spring[address]
        return Effect.on_joint(channels, self.joint, -away)


def _typical_torque(robot: Robot) -> float:
    """Of what is no motor [N m]."""
    return robot.total_mass_kg * float(np.linalg.norm(robot.model.opt.gravity)) * TYPICAL_LEVER_M


def _check_joint(robot: Robot, joint: str) -> None:
    """Refuse what is no joint, and dampers that are not the joints' own."""
    robot.require_joint(joint)
    if not np.array_equal(robot.identification_model(()).dof_damping, robot.model.dof_damping):
        raise ModelError(
            f"{robot.source}: actuators damp joints, too; give that damping to the joints to have it identified."
        )
