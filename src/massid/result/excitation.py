"""Does the log reveal what was asked for? Judged after the fit, from the information of the windows seen.

Of a stream nothing can be said beforehand; of a log `verdict` says more, before anything is fitted.

The sum of the windows' Gauss-Newton Hessians is the information about the parameters. Were every output read with the
noise of ordinary joint encoders, the standard deviation of each estimate would follow from its inverse. A parameter
whose deviation exceeds a quarter of its nominal value is not identifiable from this log: any number for it would be
made up, however well the noise-free equations can be solved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massid.search.parameters import ParameterSpace
from massid.typing import BoolArray, FloatArray

REFERENCE_NOISE = 0.02
"""Velocity noise of an ordinary joint encoder [rad/s] per sample at 1 kHz."""
LARGEST_DEVIATION = 0.25
"""Relative standard deviation beyond which a mass is not identifiable: its 95 % interval reaches from half of the
nominal mass to half as much again."""


@dataclass(frozen=True)
class Excitation:
    """What the log reveals.

    Attributes:
        reference_std: deviation of each parameter under the reference noise, in its unit, shape (n_p,); inf when the
            log holds nothing about it.
        identifiable: whether that is below a quarter of the parameter's scale, shape (n_p,).
        condition: ratio of the largest to the smallest eigenvalue of the information in units of the scales.
    """

    reference_std: FloatArray
    identifiable: BoolArray
    condition: float


def from_deviations(space: ParameterSpace, std: FloatArray) -> Excitation:
    """Judge parameters by the standard deviations that a noisy log leaves them, shape (n_p,)."""
    relative = std / space.scale
    return Excitation(std, relative < LARGEST_DEVIATION, float(np.max(relative) / max(np.min(relative), 1e-300)) ** 2)


def assess_excitation(space: ParameterSpace, curvature: FloatArray, timestep_s: float) -> Excitation:
    """Judge the sum of the windows' Hessians of mu.

    Args:
        space: what was unknown.
        curvature: sum of the Hessians, shape (n_p, n_p).
        timestep_s: sample period of the log [s].
    """
    information = 0.5 * curvature * np.outer(space.scale, space.scale) / (REFERENCE_NOISE**2 * timestep_s)
    eigenvalues, vectors = np.linalg.eigh(information)
    floor = 1e-14 * max(float(eigenvalues[-1]), np.finfo(float).tiny)
    variance = (vectors**2) @ (1.0 / np.maximum(eigenvalues, floor))
    hidden = (vectors**2) @ (eigenvalues <= floor).astype(float) > 1e-6
    relative = np.where(hidden, np.inf, np.sqrt(variance))
    return Excitation(
        reference_std=relative * space.scale,
        identifiable=relative < LARGEST_DEVIATION,
        condition=float(eigenvalues[-1] / max(float(eigenvalues[0]), floor)),
    )
