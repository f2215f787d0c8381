"""Tasks of the whole-body programme: what each part of the robot shall do, as wanted accelerations."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from massid.typing import FloatArray
from massid.walking.excitation import Reference
from massid.walking.morphology import Morphology
from massid.walking.qp import JointTask, MotionTask
from massid.walking.stance import rotation_vector
from massid.walking.state import Frame, RobotState
from massid.walking.swing import SwingTarget


@dataclass(frozen=True)
class Gains:
    """A task's weight, stiffness [1/s^2] and damping [1/s]."""

    weight: float
    stiffness: float
    damping: float


@dataclass(frozen=True)
class TaskOptions:
    """Gains of all tasks.

    Attributes:
        standing: feet on the floor; its stiffness acts on their tilt only.
        swinging: the foot in the air.
        pelvis: orientation of the root.
        torso: orientation of the torso.
        upper: rest pose of arms and back.
        legs: rest pose of the legs.
        knee: keeps a knee from straightening; its weight is reached when the knee is straight.
        knee_bend_rad: bend below which the knee task acts.
        knee_lookahead_s: the bend is judged this much ahead.
        height_stiffness: of the centre of mass's height [1/s^2].
        height_damping: of the centre of mass's height [1/s].
        momentum_decay: of angular momentum about the centre of mass [1/s].
    """

    standing: Gains = Gains(1000.0, 100.0, 10.0)
    swinging: Gains = Gains(100.0, 500.0, 42.0)
    pelvis: Gains = Gains(10.0, 150.0, 22.0)
    torso: Gains = Gains(5.0, 100.0, 18.0)
    upper: Gains = Gains(0.05, 60.0, 14.0)
    legs: Gains = Gains(1e-3, 60.0, 14.0)
    knee: Gains = Gains(5.0, 200.0, 28.0)
    knee_bend_rad: float = 0.35
    knee_lookahead_s: float = 0.1
    height_stiffness: float = 80.0
    height_damping: float = 16.0
    momentum_decay: float = 5.0


class Tasks:
    """Turns references into tasks.

    Args:
        model: the robot.
        morphology: its parts.
        rest_qpos: pose that joints return to, shape (nq,).
        options: gains.
    """

    def __init__(
        self, model: mujoco.MjModel, morphology: Morphology, rest_qpos: FloatArray, options: TaskOptions
    ) -> None:
        self._morphology = morphology
        self._options = options
        self._rest = np.concatenate([np.zeros(6), rest_qpos[7:]])
        upper, legs = options.upper, options.legs
        self._weight, self._stiffness, self._damping = (np.zeros(model.nv) for _ in range(3))
        for gains, dofs in (
            (upper, morphology.arm_dofs),
            (upper, morphology.back_dofs),
            (legs, np.concatenate(morphology.leg_dofs)),
        ):
            self._weight[dofs] = gains.weight
            self._stiffness[dofs] = gains.stiffness
            self._damping[dofs] = gains.damping

    def height(self, state: RobotState, height_m: float, offset: Reference) -> float:
        """Vertical acceleration of the centre of mass [m/s^2] that brings it to height_m plus an offset."""
        options = self._options
        error = height_m + offset.value[0] - state.com[2]
        rate = offset.rate[0] - state.com_velocity[2]
        return float(options.height_stiffness * error + options.height_damping * rate + offset.acceleration[0])

    def momentum_rate(self, state: RobotState) -> FloatArray:
        """Rate of angular momentum [N m] that lets it decay, shape (3,)."""
        rate: FloatArray = -self._options.momentum_decay * state.angular_momentum
        return rate

    def standing_foot(self, foot: Frame) -> MotionTask:
        """The foot stays where it is, its sole on the floor."""
        gains = self._options.standing
        target = -gains.damping * foot.velocity - foot.drift
        up = foot.rotation[:, 2]
        target[3:5] += gains.stiffness * np.array([up[1], -up[0]])
        return MotionTask(foot.jacobian, target, gains.weight)

    def swinging_foot(self, foot: Frame, target: SwingTarget) -> MotionTask:
        """The foot follows its trajectory, level."""
        gains = self._options.swinging
        error, rate, acceleration = np.empty(6), np.zeros(6), np.zeros(6)
        error[:3] = target.position - foot.position
        error[3:] = orientation_error(foot.rotation, _euler(0.0, 0.0, target.yaw_rad))
        rate[:3], rate[5] = target.velocity, target.yaw_rate
        acceleration[:3], acceleration[5] = target.acceleration, target.yaw_acceleration
        wanted = acceleration + gains.stiffness * error + gains.damping * (rate - foot.velocity)
        return MotionTask(foot.jacobian, wanted - foot.drift, gains.weight)

    def trunk(self, state: RobotState, yaw_rad: float, torso: Reference) -> list[MotionTask]:
        """The pelvis stays level and heads to yaw_rad; the torso moves about that heading."""
        zero = np.zeros(3)
        tasks = [_orientation(state.pelvis, _euler(0.0, 0.0, yaw_rad), zero, zero, self._options.pelvis)]
        if state.torso is not state.pelvis:
            roll, pitch, yaw = torso.value
            heading = _euler(0.0, 0.0, yaw_rad)
            wanted = _euler(roll, pitch, yaw_rad + yaw)
            rate, acceleration = heading @ torso.rate, heading @ torso.acceleration
            tasks.append(_orientation(state.torso, wanted, rate, acceleration, self._options.torso))
        return tasks

    def joints(self, state: RobotState, arms: Reference) -> JointTask:
        """Joints return to their rest pose, arms to theirs plus an offset; knees keep bent."""
        q, qd = np.concatenate([np.zeros(6), state.qpos[7:]]), state.qvel
        error = self._rest - q
        rate = -qd
        dofs = self._morphology.arm_dofs
        error[dofs] += arms.value
        rate[dofs] += arms.rate
        target = self._stiffness * error + self._damping * rate
        target[dofs] += arms.acceleration
        weight = self._weight.copy()
        self._add_knees(q, qd, weight, target)
        return JointTask(weight, target)

    def _add_knees(self, q: FloatArray, qd: FloatArray, weight: FloatArray, target: FloatArray) -> None:
        """Merge the knee task into the posture's weights and targets, in place."""
        options, morphology = self._options, self._morphology
        dofs, signs = morphology.knee_dofs, morphology.knee_bend_signs
        bend = signs * (q[dofs] - morphology.knee_straight_rad)
        rate = signs * qd[dofs]
        short = options.knee_bend_rad - bend - options.knee_lookahead_s * rate
        for i, dof in enumerate(dofs):
            if short[i] <= 0.0:
                continue
            gains = options.knee
            extra = gains.weight * min(short[i] / options.knee_bend_rad, 1.0)
            wanted = gains.stiffness * (options.knee_bend_rad - bend[i]) - gains.damping * rate[i]
            total = weight[dof] + extra
            target[dof] = (weight[dof] * target[dof] + extra * signs[i] * wanted) / total
            weight[dof] = total


def orientation_error(actual: FloatArray, wanted: FloatArray) -> FloatArray:
    """Rotation vector in the world [rad] that turns actual into wanted, shape (3,)."""
    return rotation_vector(wanted @ actual.T)


def _orientation(
    frame: Frame, wanted: FloatArray, rate: FloatArray, acceleration: FloatArray, gains: Gains
) -> MotionTask:
    error = orientation_error(frame.rotation, wanted)
    target = acceleration + gains.stiffness * error + gains.damping * (rate - frame.velocity[3:])
    return MotionTask(frame.jacobian[3:], target - frame.drift[3:], gains.weight)


def _euler(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Rotation matrix Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
