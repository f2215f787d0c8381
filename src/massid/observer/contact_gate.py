"""When a foot is off the ground: its wrench is then known to be zero, and what its sensor reads is error."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from massid.observer.spans import Spans
from massid.typing import BoolArray, FloatArray
from massid.walk.noise import SensorNoise

_OF_NOISE, _OF_OFFSET = 4.5, 3.0
"""Deviations that are allowed, of averaged noise and of the offset: noise is new in every sample and has many chances
to stand out."""


def is_unloaded(wrench: FloatArray, noise: SensorNoise, timestep_s: float) -> BoolArray:
    """Whether each contact sensor reads nothing but its own errors, shape (n, n_contacts).

    A foot is unloaded where all six averaged components are as close to zero as noise and offset let them be, and have
    been for a while.

    Args:
        wrench: readings, six columns per contact body, shape (n, 6 n_contacts) [N, N m].
        noise: of the sensors.
        timestep_s: sample period [s].
    """
    spans = Spans.at(timestep_s)
    width, settling = spans.width, spans.settling
    if not len(wrench):
        return np.zeros((0, wrench.shape[1] // 6), dtype=np.bool_)
    offset = np.repeat([noise.force_offset, 0.0], 3)
    limit = np.sqrt((_OF_OFFSET * offset) ** 2 + (_OF_NOISE * noise.wrench_std()) ** 2 / width)
    mean = uniform_filter1d(wrench, width, axis=0, mode="mirror").reshape(len(wrench), -1, 6)
    loaded = (np.abs(mean) > limit).any(axis=2)
    # Looks back by `settling` samples, and ahead by none.
    recently = maximum_filter1d(
        loaded.astype(np.uint8), settling + 1, axis=0, origin=settling // 2, mode="constant", cval=0
    )
    return np.asarray(recently == 0)
