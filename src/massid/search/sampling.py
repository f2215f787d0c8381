"""Local sampling around an estimate (Algorithm 1, line 8): balls, cubes, antithetic pairs."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray

Sampling: TypeAlias = Literal["pairs", "ball", "cube"]


def sample_locally(
    centre: FloatArray,
    n_samples: int,
    radius: float,
    space: ParameterSpace,
    rng: np.random.Generator,
    sampling: Sampling = "pairs",
) -> FloatArray:
    """Draw points of Theta in the vicinity of a centre.

    `ball` and `cube` fill B(p, r) and H(p, r) uniformly, in units of the parameters' scales. `pairs` puts p + d and
    p - d on the sphere, with as many d orthogonal to each other as there are dimensions, so that even terms of mu
    cancel in the gradient; with fewer than 2 n_p samples it takes n_p directions first and their mirror images after.

    Args:
        centre: shape (n_p,).
        n_samples: number of points, >= n_p.
        radius: r, as a fraction of the parameters' scales.
        space: Theta and the scales.
        rng: source of randomness.
        sampling: the shape of the vicinity.

    Returns:
        Points of Theta, shape (n_samples, n_p); coordinates that enter as tangents stay at the centre.
    """
    n_p = space.n_sampled
    match sampling:
        case "pairs":
            offsets = _antithetic(n_samples, n_p, rng)
        case "ball":
            directions = rng.normal(size=(n_samples, n_p))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            offsets = directions * rng.uniform(size=(n_samples, 1)) ** (1.0 / n_p)
        case "cube":
            offsets = rng.uniform(-1.0, 1.0, size=(n_samples, n_p))
    points = np.repeat(centre[None], n_samples, axis=0)
    points[:, :n_p] += radius * space.scale[:n_p] * offsets
    return space.project(points)


def _antithetic(n_samples: int, n_p: int, rng: np.random.Generator) -> FloatArray:
    """Unit vectors in opposite pairs; shape (n_samples, n_p)."""
    n_directions = max(n_p, (n_samples + 1) // 2)
    bases = []
    for _ in range(-(-n_directions // n_p)):
        basis, _ = np.linalg.qr(rng.normal(size=(n_p, n_p)))
        bases.append(basis)
    directions = np.vstack(bases)[:n_directions]
    return np.vstack([directions, -directions])[:n_samples]
