"""Estimators of the gradient of mu compared, with noise and with corrupted or diverged models (Section III)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.paper.setting import N_MODELS, TIMESTEP_S
from massid.search.gradient import GradientEstimator, estimate_gradient
from massid.search.monitoring import Monitoring
from massid.search.online import score_block
from massid.search.proposal import Proposal, Role
from massid.search.sampling import Sampling, sample_locally
from massid.systems import non_affine
from massid.systems.bank import SystemBank
from massid.systems.non_affine import non_affine_plant, non_affine_system
from massid.typing import FloatArray

RADIUS = 0.1
DRAWS = 50
CORRUPTION = 3.0
"""A corrupted model's score is multiplied by this."""
METHODS: tuple[tuple[str, GradientEstimator, Sampling], ...] = (
    ("n_p + 1 differences", "differences", "ball"),
    ("least squares", "least-squares", "ball"),
    ("RANSAC", "ransac", "ball"),
    ("antithetic pairs, least squares", "least-squares", "pairs"),
    ("antithetic pairs, RANSAC", "ransac", "pairs"),
    ("antithetic pairs, Gram matrix", "gram", "pairs"),
)
CASES = ("no noise", "noise", "noise, 2 models corrupted", "noise, 2 models diverged")


@dataclass(frozen=True)
class EstimatorOutcome:
    """One estimator.

    Attributes:
        method: its name.
        error: median over draws of |g - g_exact| / |g_exact| in units of the scales, one for each of `CASES`.
    """

    method: str
    error: tuple[float, ...]


def compare_estimators(n_models: int = N_MODELS + 4) -> list[EstimatorOutcome]:
    """Gradients at the paper's p0 of V-B over one window, against central differences with a tiny step.

    Args:
        n_models: the centre and 4 n_p samples, so that two can be lost.
    """
    outcomes = []
    for method, estimator, sampling in METHODS:
        errors = tuple(_median_error(estimator, sampling, case, n_models) for case in CASES)
        outcomes.append(EstimatorOutcome(method, errors))
    return outcomes


def _median_error(estimator: GradientEstimator, sampling: Sampling, case: str, n_models: int) -> float:
    system = non_affine_system()
    noise = 0.0 if case == "no noise" else non_affine.NOISE
    plant = non_affine_plant(system, np.random.default_rng(1), noise=noise, timestep_s=TIMESTEP_S)
    bank = SystemBank(system, n_models, TIMESTEP_S)
    exact_bank = SystemBank(system, 7, TIMESTEP_S)
    errors = []
    for draw in range(DRAWS):
        rng = np.random.default_rng(draw)
        block = plant.run(1.0, non_affine.START).block
        step = 1e-5
        points = np.vstack([non_affine.START, non_affine.START + step * np.vstack([np.eye(3), -np.eye(3)])])
        mu = score_block(exact_bank, Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * 6)), block, 0.0).mu
        exact = (mu[1:4] - mu[4:]) / (2.0 * step)
        samples = sample_locally(non_affine.START, n_models - 1, RADIUS, system.space, rng, sampling)
        proposal = Proposal(np.vstack([non_affine.START, samples]), (Role.CENTRE, *[Role.SAMPLE] * (n_models - 1)))
        monitoring = _spoil(score_block(bank, proposal, block, 0.0), case, rng)
        gradient = estimate_gradient(monitoring, estimator, rng)
        errors.append(_distance(gradient, exact, system.space.scale))
    return float(np.median(errors))


def _spoil(monitoring: Monitoring, case: str, rng: np.random.Generator) -> Monitoring:
    """Corrupt or lose two of the samples."""
    lost = 1 + rng.choice(len(monitoring.diverged) - 1, size=2, replace=False)
    if "corrupted" in case:
        factor = np.ones(len(monitoring.diverged))
        factor[lost] = np.sqrt(CORRUPTION)
        return replace(monitoring, gram=monitoring.gram * np.outer(factor, factor))
    if "diverged" in case:
        diverged = monitoring.diverged.copy()
        diverged[lost] = True
        return replace(monitoring, diverged=diverged)
    return monitoring


def _distance(gradient: FloatArray, exact: FloatArray, scale: FloatArray) -> float:
    return float(np.linalg.norm(scale * (gradient - exact)) / np.linalg.norm(scale * exact))
