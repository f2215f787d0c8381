"""Trajectory of a swinging foot: quintics from where it left the floor to where it shall land."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massid.typing import FloatArray
from massid.walking.footsteps import FootPose

_HORIZONTAL_DONE = 0.92
_APEX_AT = 0.45
_LATE_SPEED_M_S = 0.15


@dataclass(frozen=True)
class SwingTarget:
    """What the swinging foot shall do now.

    Attributes:
        position: of the sole's centre [m], shape (3,).
        velocity: its rate [m/s], shape (3,).
        acceleration: its second rate [m/s^2], shape (3,).
        yaw_rad: heading.
        yaw_rate: its rate [rad/s].
        yaw_acceleration: its second rate [rad/s^2].
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    yaw_rad: float
    yaw_rate: float
    yaw_acceleration: float


@dataclass(frozen=True)
class SwingTrajectory:
    """One swing.

    Attributes:
        start: pose at lift-off.
        end: pose at touchdown.
        duration_s: planned time in the air.
        apex_m: height of the highest point above the higher of start and end.
        landing_m_s: speed at which the foot comes down at the end of the planned time.
    """

    start: FootPose
    end: FootPose
    duration_s: float
    apex_m: float
    landing_m_s: float = 0.0

    def at(self, time_s: float) -> SwingTarget:
        """Target after time_s [s] in the air; goes on downwards when touchdown is late."""
        level, rate, second = quintic(time_s, _HORIZONTAL_DONE * self.duration_s)
        travel = self.end.position - self.start.position
        turn = wrap(self.end.yaw_rad - self.start.yaw_rad)
        position = self.start.position + level * travel
        velocity = rate * travel
        acceleration = second * travel
        position[2], velocity[2], acceleration[2] = self._vertical(time_s)
        return SwingTarget(
            position=position,
            velocity=velocity,
            acceleration=acceleration,
            yaw_rad=self.start.yaw_rad + level * turn,
            yaw_rate=rate * turn,
            yaw_acceleration=second * turn,
        )

    def _vertical(self, time_s: float) -> tuple[float, float, float]:
        low, high = float(self.start.position[2]), float(self.end.position[2])
        apex = max(low, high) + self.apex_m
        split = _APEX_AT * self.duration_s
        if time_s > self.duration_s:
            speed = max(self.landing_m_s, _LATE_SPEED_M_S)
            return high - speed * (time_s - self.duration_s), -speed, 0.0
        if time_s < split:
            level, rate, second = quintic(time_s, split)
            return low + level * (apex - low), rate * (apex - low), second * (apex - low)
        level, rate, second = quintic(time_s - split, self.duration_s - split)
        late, late_rate, late_second = _moving_end(time_s - split, self.duration_s - split)
        fall, speed = high - apex, self.landing_m_s
        return (
            apex + level * fall - late * speed,
            rate * fall - late_rate * speed,
            second * fall - late_second * speed,
        )


def quintic(time_s: float, duration_s: float) -> tuple[float, float, float]:
    """Rise from 0 to 1 with zero rate and second rate at both ends: value, rate [1/s], second rate [1/s^2]."""
    if time_s <= 0.0:
        return 0.0, 0.0, 0.0
    if time_s >= duration_s:
        return 1.0, 0.0, 0.0
    s = time_s / duration_s
    value = s**3 * (10 - 15 * s + 6 * s**2)
    rate = 30 * s**2 * (1 - s) ** 2 / duration_s
    second = 60 * s * (1 - s) * (1 - 2 * s) / duration_s**2
    return value, rate, second


def _moving_end(time_s: float, duration_s: float) -> tuple[float, float, float]:
    """What a quintic gains by ending at a rate of one: value [s], rate, second rate [1/s]; zero at both ends else."""
    s = time_s / duration_s
    value = s**3 * (-4 + 7 * s - 3 * s**2) * duration_s
    rate = s**2 * (-12 + 28 * s - 15 * s**2)
    second = s * (-24 + 84 * s - 60 * s**2) / duration_s
    return value, rate, second


def wrap(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return float((angle_rad + np.pi) % (2 * np.pi) - np.pi)
