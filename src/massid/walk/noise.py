"""Sensor noise of real humanoids: descriptions, presets, and the sensors that a simulated robot is measured with.

Standard deviations are per sample at 1 kHz. White noise is drawn anew for every sample; slow errors (offsets, gains)
once per walk.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from massid.errors import BadInputError
from massid.typing import FloatArray
from massid.walk.walk import Walk

NoisePreset: TypeAlias = Literal["clean", "white", "realistic", "harsh"]


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of every measured channel.

    Attributes:
        joint_position: white [rad].
        joint_velocity: white [rad/s].
        effort: white [N m].
        base_position: white [m].
        base_orientation: white, rotation vector in the base frame [rad].
        base_linear_velocity: white [m/s].
        base_angular_velocity: white [rad/s].
        force: white [N].
        moment: white [N m].
        joint_position_offset: constant per joint [rad].
        effort_gain: constant per joint, relative.
        effort_offset: constant per joint [N m].
        wrench_gain: constant per contact body and axis, relative.
        force_offset: constant per contact body and axis [N].
    """

    joint_position: float = 0.0
    joint_velocity: float = 0.0
    effort: float = 0.0
    base_position: float = 0.0
    base_orientation: float = 0.0
    base_linear_velocity: float = 0.0
    base_angular_velocity: float = 0.0
    force: float = 0.0
    moment: float = 0.0
    joint_position_offset: float = 0.0
    effort_gain: float = 0.0
    effort_offset: float = 0.0
    wrench_gain: float = 0.0
    force_offset: float = 0.0

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) >= 0.0:
                raise BadInputError(f"Noise {entry.name} is {getattr(self, entry.name)}; it must not be negative.")

    def scaled(self, factor: float) -> SensorNoise:
        """Every deviation times a factor."""
        return SensorNoise(**{entry.name: factor * getattr(self, entry.name) for entry in fields(self)})

    def state_std(self, n_joints: int) -> FloatArray:
        """White noise of (q, qd) in the order of a walk's columns, shape (2 (6 + n_joints),)."""
        return np.concatenate(
            [
                np.repeat([self.base_position, self.base_orientation], 3),
                np.full(n_joints, self.joint_position),
                np.repeat([self.base_linear_velocity, self.base_angular_velocity], 3),
                np.full(n_joints, self.joint_velocity),
            ]
        )

    def wrench_std(self) -> FloatArray:
        """White noise of one contact wrench (force, moment), shape (6,)."""
        return np.repeat([self.force, self.moment], 3)


_WHITE = SensorNoise(
    joint_position=0.3e-3,
    joint_velocity=0.02,
    effort=0.4,
    base_position=2e-3,
    base_orientation=3e-3,
    base_linear_velocity=0.02,
    base_angular_velocity=5e-3,
    force=2.0,
    moment=0.1,
)
_REALISTIC = replace(
    _WHITE,
    joint_position_offset=2e-3,
    effort_gain=0.02,
    effort_offset=0.4,
    wrench_gain=0.01,
    force_offset=4.0,
)
PRESETS: dict[NoisePreset, SensorNoise] = {
    "clean": SensorNoise(),
    "white": _WHITE,
    "realistic": _REALISTIC,
    "harsh": _REALISTIC.scaled(2.0),
}


class Sensors:
    """The sensors of one robot on one day: slow errors are drawn once, white noise as they measure.

    Args:
        noise: standard deviations.
        n_joints: number of joints.
        contact_bodies: bodies whose wrench is measured.
        rng: source of randomness.
    """

    def __init__(
        self, noise: SensorNoise, n_joints: int, contact_bodies: Sequence[str], rng: np.random.Generator
    ) -> None:
        self.noise = noise
        self.contact_bodies = tuple(contact_bodies)
        self._rng = rng
        n_contacts = len(self.contact_bodies)
        self.joint_position_offset = noise.joint_position_offset * rng.normal(size=n_joints)
        self.effort_gain = 1.0 + noise.effort_gain * rng.normal(size=n_joints)
        self.effort_offset = noise.effort_offset * rng.normal(size=n_joints)
        self.wrench_gain = 1.0 + noise.wrench_gain * rng.normal(size=(n_contacts, 6))
        self.wrench_offset = np.zeros((n_contacts, 6))
        self.wrench_offset[:, :3] = noise.force_offset * rng.normal(size=(n_contacts, 3))

    def measure(self, walk: Walk) -> Walk:
        """What these sensors would have logged of a noise-free walk."""
        noise, rng = self.noise, self._rng
        n, n_joints = walk.effort.shape
        std = noise.state_std(n_joints)
        n_v = 6 + n_joints
        qpos = walk.qpos.copy()
        qpos[:, :3] += std[:3] * rng.normal(size=(n, 3))
        qpos[:, 3:7] = rotate(qpos[:, 3:7], std[3:6] * rng.normal(size=(n, 3)))
        qpos[:, 7:] += self.joint_position_offset + std[6:n_v] * rng.normal(size=(n, n_joints))
        qvel = walk.qvel + std[n_v:] * rng.normal(size=(n, n_v))
        effort = self.effort_gain * walk.effort + self.effort_offset + noise.effort * rng.normal(size=(n, n_joints))
        wrench = (
            self.wrench_gain * walk.wrench
            + self.wrench_offset
            + noise.wrench_std() * rng.normal(size=walk.wrench.shape)
        )
        return replace(walk, qpos=qpos, qvel=qvel, effort=effort, wrench=wrench)

    def drawn(self) -> dict[str, Any]:
        """The slow errors, for the truth file and nobody else."""
        return {
            "joint_position_offset_rad": self.joint_position_offset.tolist(),
            "effort_gain": self.effort_gain.tolist(),
            "effort_offset_nm": self.effort_offset.tolist(),
            "wrench_gain": dict(zip(self.contact_bodies, self.wrench_gain.tolist(), strict=True)),
            "wrench_offset": dict(zip(self.contact_bodies, self.wrench_offset.tolist(), strict=True)),
        }


def rotate(quaternion: FloatArray, rotation: FloatArray) -> FloatArray:
    """Turn unit quaternions (wxyz) by rotation vectors in their own frames.

    Args:
        quaternion: shape (n, 4).
        rotation: shape (n, 3) [rad].
    """
    angle = np.linalg.norm(rotation, axis=1, keepdims=True)
    bw, b = np.cos(0.5 * angle), 0.5 * np.sinc(angle / (2.0 * np.pi)) * rotation
    aw, a = quaternion[:, :1], quaternion[:, 1:]
    turned = np.hstack([aw * bw - np.sum(a * b, axis=1, keepdims=True), aw * b + bw * a + np.cross(a, b)])
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))
