"""Estimators of the gradient of mu at the centre (Section III, step 2)."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from massid.search.monitoring import Monitoring
from massid.typing import BoolArray, FloatArray

GradientEstimator: TypeAlias = Literal["gram", "differences", "least-squares", "ransac"]

_OUTLIER_DEVIATIONS = 4.0
_RANSAC_TRIALS = 100


def estimate_gradient(monitoring: Monitoring, estimator: GradientEstimator, rng: np.random.Generator) -> FloatArray:
    """Gradient of mu at the centre, shape (n_p,).

    `gram` uses output errors (see `Monitoring.local_quadratic`); the others see scores alone: `differences` the
    centre and n_p samples, `least-squares` an affine fit to all, `ransac` the same after removing outliers.

    Raises:
        DivergedBankError: too few models stayed finite.
    """
    if estimator == "gram":
        return monitoring.local_quadratic().gradient
    monitoring.require_finite()
    proposal = monitoring.proposal
    samples = proposal.samples[~monitoring.diverged[proposal.samples]]
    n_p = monitoring.proposal.n_sampled
    offsets = proposal.points[samples, :n_p] - proposal.points[proposal.centre, :n_p]
    rise = monitoring.mu[samples] - monitoring.mu[proposal.centre]
    match estimator:
        case "differences":
            sampled, *_ = np.linalg.lstsq(offsets[:n_p], rise[:n_p])
        case "least-squares":
            sampled = _affine_fit(offsets, rise)[1:]
        case "ransac":
            inliers = ransac_inliers(offsets, rise, rng)
            sampled = _affine_fit(offsets[inliers], rise[inliers])[1:]
    if n_p == proposal.points.shape[1]:
        return np.asarray(sampled)
    gradient = monitoring.local_quadratic().gradient.copy()  # coordinates without samples come from their tangents
    gradient[:n_p] = sampled
    return gradient


def ransac_inliers(offsets: FloatArray, rise: FloatArray, rng: np.random.Generator) -> BoolArray:
    """Find the samples that agree on one affine mu (RANSAC, reference [16] of the paper).

    The threshold is not a number to tune: residuals of each trial are compared with the smallest median absolute
    residual that any trial reaches.

    Args:
        offsets: samples relative to the centre, shape (n, n_p).
        rise: mu of the samples minus mu of the centre, shape (n,).
        rng: source of randomness.

    Returns:
        Mask of shape (n,), true for at least n_p + 1 samples.
    """
    n, n_p = offsets.shape
    everyone = np.ones(n, dtype=np.bool_)
    if n <= n_p + 2:
        return everyone
    best_scale, best_residual = np.inf, np.zeros(n)
    design = np.hstack([np.ones((n, 1)), offsets])
    for _ in range(_RANSAC_TRIALS):
        chosen = rng.choice(n, size=n_p + 1, replace=False)
        solution, _, rank, _ = np.linalg.lstsq(design[chosen], rise[chosen])
        if rank <= n_p:
            continue
        residual = np.abs(design @ solution - rise)
        scale = np.sort(residual)[(n + n_p) // 2]  # the n_p + 1 chosen ones fit by construction
        if scale < best_scale:
            best_scale, best_residual = scale, residual
    inliers = best_residual <= _OUTLIER_DEVIATIONS * 1.4826 * best_scale
    return inliers if inliers.sum() > n_p else everyone


def _affine_fit(offsets: FloatArray, rise: FloatArray) -> FloatArray:
    """Least-squares [intercept, slope], shape (1 + n_p,)."""
    scale = np.sqrt(np.mean(offsets**2, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    design = np.hstack([np.ones((len(offsets), 1)), offsets / scale])
    solution, *_ = np.linalg.lstsq(design, rise)
    solution[1:] /= scale
    return np.asarray(solution)
