"""When a foot is off the ground: its wrench is then known to be zero, and what its sensor reads is error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from massid.model.unknowns.sensors import WrenchOffset
from massid.observer.spans import Spans
from massid.search.parameters import ParameterSpace
from massid.typing import BoolArray, FloatArray, IntArray
from massid.walk.noise import SensorNoise

_OF_NOISE, _OF_OFFSET = 4.5, 3.0
"""Deviations that are allowed, of averaged noise and of the offset: noise is new in every sample and has many chances
to stand out."""


_OF_MEDIAN = 1.25
"""Deviation of the median of normal numbers, with that of their mean as unit."""
_ROUNDS = 3
"""In each, what a foot that hardly touches the ground adds to the readings in the air is left out a little better."""


@dataclass(frozen=True)
class ForceOffsets:
    """What contact sensors read too much, six numbers per contact body [N, N m].

    Attributes:
        mean: as far as is known, shape (6 n_contacts,).
        std: how well, shape (6 n_contacts,).
    """

    mean: FloatArray
    std: FloatArray

    @classmethod
    def unknown(cls, noise: SensorNoise, n_contacts: int) -> ForceOffsets:
        """Nothing but how large they may be."""
        std = np.tile(np.repeat([noise.force_offset, 0.0], 3), n_contacts)
        return cls(np.zeros(len(std)), std)

    @classmethod
    def believed(cls, space: ParameterSpace, contact_bodies: Sequence[str], noise: SensorNoise) -> ForceOffsets:
        """What is believed of them before the fit."""
        offsets = cls.unknown(noise, len(contact_bodies))
        for unknown in space.parameters:
            if isinstance(unknown, WrenchOffset) and unknown.body in contact_bodies and unknown.prior_std is not None:
                axis = 6 * list(contact_bodies).index(unknown.body) + unknown.axis
                offsets.mean[axis], offsets.std[axis] = unknown.nominal, unknown.prior_std
        return offsets


def offsets_in_air(
    wrench: FloatArray,
    noise: SensorNoise,
    timestep_s: float,
    least_force: float,
    open_axes: Sequence[int] | IntArray = (),
) -> ForceOffsets:
    """What the force sensors read while their foot is off the ground, with what was believed of them before.

    Heel or toe of a foot of several bodies may carry a few newtons for long, less than an offset may be. So a first
    guess is the median, which some such readings move little, and what then is too far from it to be noise is load.

    Args:
        wrench: readings, six columns per contact body, shape (n, 6 n_contacts) [N, N m].
        noise: of the sensors.
        timestep_s: sample period [s].
        least_force: white noise that a force has at least, for a simulated sensor may read plain zero [N].
        open_axes: columns that are not measured.
    """
    n_contacts = wrench.shape[1] // 6
    believed = ForceOffsets.unknown(noise, n_contacts)
    if not believed.std.any():
        return believed
    std = np.tile(np.repeat([max(noise.force, least_force), np.inf], 3), n_contacts)
    prior = np.divide(1.0, believed.std**2, out=np.full(len(std), np.inf), where=believed.std > 0.0)

    def in_air(offsets: ForceOffsets) -> tuple[BoolArray, FloatArray]:
        """Which readings are, and how well what they say and what was believed before tell the offsets."""
        unloaded = np.repeat(is_unloaded(wrench, noise, timestep_s, offsets, open_axes), 6, axis=1)
        return unloaded, prior + unloaded.sum(axis=0) / std**2

    for _ in range(_ROUNDS):
        unloaded, precision = in_air(believed)
        told = unloaded.any(axis=0)
        mean = believed.mean.copy()
        for axis in np.flatnonzero((believed.std > 0.0) & told):
            mean[axis] = np.median(wrench[unloaded[:, axis], axis])
        believed = ForceOffsets(mean, np.where(told, _OF_MEDIAN, 1.0) / np.sqrt(precision))
    unloaded, precision = in_air(believed)
    total = np.where(unloaded, wrench, 0.0).sum(axis=0)
    return ForceOffsets(total / std**2 / precision, 1.0 / np.sqrt(precision))


def is_unloaded(
    wrench: FloatArray,
    noise: SensorNoise,
    timestep_s: float,
    offsets: ForceOffsets | None = None,
    open_axes: Sequence[int] | IntArray = (),
) -> BoolArray:
    """Whether each contact sensor reads nothing but its own errors, shape (n, n_contacts).

    A foot is unloaded where all averaged components that are measured are as close to their offset as noise and what is
    known of it let them be, and have been for a while. One without any sensor is unloaded where its wrench was found to
    be zero (`massid.observer.ground`).

    Args:
        wrench: readings, six columns per contact body, shape (n, 6 n_contacts) [N, N m].
        noise: of the sensors.
        timestep_s: sample period [s].
        offsets: what is believed of the sensors; default how large their errors may be.
        open_axes: columns that are not measured.
    """
    spans = Spans.at(timestep_s)
    width, settling = spans.width, spans.settling
    if not len(wrench):
        return np.zeros((0, wrench.shape[1] // 6), dtype=np.bool_)
    offsets = ForceOffsets.unknown(noise, wrench.shape[1] // 6) if offsets is None else offsets
    of_noise = np.tile(_OF_NOISE * noise.wrench_std(), wrench.shape[1] // 6)
    limit = np.sqrt((_OF_OFFSET * offsets.std) ** 2 + of_noise**2 / width)
    mean = uniform_filter1d(wrench, width, axis=0, mode="mirror")
    is_open = np.zeros(wrench.shape[1], dtype=np.bool_)
    is_open[list(open_axes)] = True
    loaded = ((np.abs(mean - offsets.mean) > limit) & ~is_open).reshape(len(wrench), -1, 6).any(axis=2)
    # Looks back by `settling` samples, and ahead by none.
    recently = maximum_filter1d(
        loaded.astype(np.uint8), settling + 1, axis=0, origin=settling // 2, mode="constant", cval=0
    )
    blind = is_open.reshape(-1, 6).all(axis=1)
    return np.where(blind, ~wrench.reshape(len(wrench), -1, 6).any(axis=2), recently == 0)
