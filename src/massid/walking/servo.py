"""Walking by position servos, as commercial humanoids do: a slow policy sets targets, stiff joints chase them.

The policy is the torque walker, asked a few dozen times a second. What it wants of a joint becomes a target that is
held until it is asked again; the servo of the joint turns it into a torque at every call,

    tau = k (target - q) - d qd,    cut off at the joint's limit.

Held over a policy's period, torques run away from what was planned as the joint moves, and step back with every new
target: they chatter, as those of a robot do that a learned policy walks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.typing import FloatArray
from massid.walking.gait import Gait
from massid.walking.morphology import is_servo
from massid.walking.walker import Walker, WalkerOptions


@dataclass(frozen=True)
class Servos:
    """The position servos of a robot's joints, each of shape (nv - 6,); zero for a joint without one.

    Attributes:
        stiffness: k [N m/rad].
        damping: d [N m s/rad].
    """

    stiffness: FloatArray
    damping: FloatArray

    @classmethod
    def from_model(cls, model: mujoco.MjModel, joint_names: Sequence[str]) -> Servos:
        """Read the servos from a model's `position` actuators.

        Args:
            model: as its file drives it.
            joint_names: joints in the order that is wanted.

        Raises:
            ModelError: one of the joints is driven by anything else, or none is driven.
        """
        stiffness, damping = np.zeros(len(joint_names)), np.zeros(len(joint_names))
        for actuator in _actuators_of(model, joint_names):
            if not _is_position_servo(model, actuator):
                raise ModelError(
                    f"Actuator '{model.actuator(actuator).name}' of the model is no position servo (a `position`"
                    " actuator with kp above zero), so targets cannot move the robot; torques can."
                )
            k = joint_names.index(model.joint(int(model.actuator_trnid[actuator, 0])).name)
            squared = float(model.actuator_gear[actuator, 0]) ** 2
            stiffness[k] = squared * model.actuator_gainprm[actuator, 0]
            damping[k] = -squared * model.actuator_biasprm[actuator, 2]
        if not stiffness.any():
            raise ModelError("No joint of the model has a position servo, so targets cannot move the robot.")
        return cls(stiffness, damping)


def driven_by_servos(model: mujoco.MjModel, joint_names: Sequence[str]) -> bool:
    """Whether a model's file drives some of the joints, and those by position servos alone."""
    actuators = _actuators_of(model, joint_names)
    return bool(actuators) and all(_is_position_servo(model, actuator) for actuator in actuators)


def _actuators_of(model: mujoco.MjModel, joint_names: Sequence[str]) -> list[int]:
    on_joint = np.flatnonzero(model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)).tolist()
    return [a for a in on_joint if model.joint(int(model.actuator_trnid[a, 0])).name in joint_names]


def _is_position_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether the actuator's force falls by as much per radian of the joint as it rises per unit of control."""
    gain, bias = float(model.actuator_gainprm[actuator, 0]), float(model.actuator_biasprm[actuator, 1])
    return is_servo(model, actuator) and gain > 0.0 and bias == -gain


@dataclass(frozen=True)
class ServoOptions:
    """Timing of policy and servos.

    Attributes:
        policy_period_s: targets are held for this long.
        servo_period_s: torques are held for this long.
        slip_rad_s: rate at which friction is taken to have turned round.
        walker: of the policy; its control period is the policy's.
    """

    policy_period_s: float = 0.02
    servo_period_s: float = 0.001
    slip_rad_s: float = 0.1
    walker: WalkerOptions = field(default_factory=WalkerOptions)


class ServoWalker:
    """Walks a humanoid by position targets of its joints' servos.

    It knows and senses what a `Walker` does.

    Args:
        model: nominal robot without a floor, its motors of one unit of torque; copied.
        gait: how to walk.
        rng: source of the gait's randomness.
        servos: of the joints.
        options: settings.

    Raises:
        ModelError: the model is not a humanoid that can stand.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        gait: Gait,
        rng: np.random.Generator,
        servos: Servos,
        options: ServoOptions | None = None,
    ) -> None:
        self._options = options or ServoOptions()
        walker = replace(self._options.walker, control_period_s=self._options.policy_period_s)
        self._policy = Walker(model, gait, rng, walker)
        self._servos = servos
        self._limits = self._policy.morphology.torque_limits_nm
        self._friction_nm = model.dof_frictionloss[6:].copy()
        self._planned: FloatArray | None = None
        self._target = np.zeros(model.nv - 6)

    @property
    def policy(self) -> Walker:
        """What sets the targets."""
        return self._policy

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints in the order of the torques."""
        return self._policy.joint_names

    @property
    def foot_names(self) -> tuple[str, str]:
        """Names of the foot bodies in the order of the loads."""
        return self._policy.foot_names

    @property
    def control_period_s(self) -> float:
        """Torques are held for this long."""
        return self._options.servo_period_s

    @property
    def failed_solves(self) -> int:
        """Policy ticks whose programme had no solution and that held the last torques."""
        return self._policy.failed_solves

    @property
    def target(self) -> FloatArray:
        """Positions that the servos chase [rad], in the order of joint_names."""
        return self._target

    def initial_qpos(self) -> FloatArray:
        """Standing pose with level soles on z = 0, shape (nq,)."""
        return self._policy.initial_qpos()

    def has_fallen(self, qpos: FloatArray) -> bool:
        """Tell whether the root has sunk or leans as `Walker.has_fallen` says."""
        return self._policy.has_fallen(qpos)

    def control(self, time_s: float, qpos: FloatArray, qvel: FloatArray, foot_load_n: FloatArray) -> FloatArray:
        """Compute the servos' torques for this instant.

        Args:
            time_s: time [s], not decreasing from call to call; the walk starts at the first call.
            qpos: measured positions, shape (nq,).
            qvel: measured velocities in MuJoCo's convention, shape (nv,).
            foot_load_n: vertical force on the left and the right foot [N], shape (2,).

        Returns:
            Torque of each joint [N m], in the order of joint_names, shape (nv - 6,).
        """
        position, rate = qpos[7:], qvel[6:]
        planned = self._policy.control(time_s, qpos, qvel, foot_load_n)
        if planned is not self._planned:
            self._planned = planned
            self._set_target(position, rate, planned)
        servos = self._servos
        torques = servos.stiffness * (self._target - position) - servos.damping * rate
        return np.asarray(np.clip(torques, -self._limits, self._limits))

    def _set_target(self, position: FloatArray, rate: FloatArray, planned: FloatArray) -> None:
        """Choose the target with which the servo gives the planned torque half-way through the policy's period.

        Friction is added where the joint is about to slip: the walker's programme does not know of it.
        """
        servos, half_s = self._servos, self._options.policy_period_s / 2.0
        acceleration = self._policy.accelerations
        rate_then = rate + half_s * acceleration
        position_then = position + half_s * rate + half_s**2 / 2.0 * acceleration
        torque = planned + self._friction_nm * np.tanh(rate_then / self._options.slip_rad_s)
        torque = np.clip(torque, -self._limits, self._limits)
        driven = servos.stiffness > 0.0
        away = np.zeros_like(torque)
        away[driven] = (torque + servos.damping * rate_then)[driven] / servos.stiffness[driven]
        self._target = position_then + away
