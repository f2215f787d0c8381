"""A motion as unknowns see it: what moved how, what acted, and what is known of loads and of sliding joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massid.model.layout import Channels
from massid.typing import FloatArray


@dataclass(frozen=True)
class Motion:
    """n instants of a walk in the model's order, with those errors of the sensors taken out that are known.

    Attributes:
        position: shape (n, nq) [rad or m].
        velocity: shape (n, nv) [rad/s or m/s].
        acceleration: shape (n, nv) [rad/s^2 or m/s^2].
        effort: joint torques as generalised forces, zero at the base, shape (n, nv) [N m or N].
        wrench: in the contact bodies' frames, zero where it is known to be, shape (n, 6 n_contacts) [N, N m].
        effort_rate: slope of the torques, shape (n, nv) [N m/s or N/s].
        wrench_rate: slope of the wrenches, zero where they are known to be, shape (n, 6 n_contacts) [N/s, N m/s].
        loaded: 0 where a wrench is known to be zero, else 1, shape (n, 6 n_contacts).
        sliding: derivative of the friction torques by the friction losses, zero where it is not known, shape (n, nv).
    """

    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    effort: FloatArray
    wrench: FloatArray
    effort_rate: FloatArray
    wrench_rate: FloatArray
    loaded: FloatArray
    sliding: FloatArray

    def __len__(self) -> int:
        return len(self.velocity)

    @classmethod
    def at_rest(cls, channels: Channels) -> Motion:
        """One instant of a robot in its model's own position, with nothing that moves or acts."""
        model, still = channels.model, np.zeros((1, channels.model.nv))
        free = np.zeros((1, 6 * len(channels.contact_bodies)))
        return cls(model.qpos0[None].copy(), still, still, still, free, still, free, free, still)
