"""Is a larger ModelSet more robust to disturbance and noise, as Section III says? Banks of several sizes on V-B."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.paper.setting import CONVERGED, N_MODELS, SETTLED, WINDOWS, NonAffineRun, as_start, random_starts
from massid.search.guided import SearchOptions
from massid.systems import non_affine
from massid.systems.online import OnlineRun

STARTS = 30
START_WINDOWS = 12
SIZES = ((N_MODELS, 0, 1), (36, 12, 1), (12, 0, 6), (30, 0, 24), (42, 12, 24))
"""Models, kept models and initial guesses of each bank."""
SHAKEN = 10.0
"""Delta is this many times as large in the column with more noise."""


@dataclass(frozen=True)
class ModelSetOutcome:
    """What a ModelSet is good for, without a scan.

    Attributes:
        n_models: size of the bank.
        kept: best models of each window that stay.
        guesses: initial guesses, the first of which gets the local samples.
        converged: random starts in Theta that found p*.
        found: random starts that found p* where Theta admits p3 < 0.
        mirrored: of those, the ones that found the mirror minimum.
        starts: how many there were.
        error: settled root mean square error from p0.
        shaken: the same with ten times the noise.
    """

    n_models: int
    kept: int
    guesses: int
    converged: int
    found: int
    mirrored: int
    starts: int
    error: float
    shaken: float


def settled_error(run: OnlineRun) -> float:
    """Root mean square error over the windows after the first few."""
    return float(np.sqrt(np.mean(run.errors(non_affine.TRUTH)[SETTLED:] ** 2)))


def compare_model_sets(starts: int = STARTS) -> list[ModelSetOutcome]:
    """Banks of several sizes; with kept models; with further guesses; and with both."""
    return [_outcome(*size, starts) for size in SIZES]


def _outcome(n_models: int, kept: int, guesses: int, starts: int) -> ModelSetOutcome:
    search = SearchOptions(kept=kept, candidates=max(SearchOptions().candidates, guesses - 1))
    base = NonAffineRun(search=search, n_models=n_models, guesses=guesses)
    ends = {
        theta: np.array(
            [
                replace(base, start=as_start(start), seed=i, windows=START_WINDOWS, theta=theta).run().estimates[-1]
                for i, start in enumerate(random_starts(starts, theta))
            ]
        )
        for theta in (non_affine.THETA, non_affine.MIRROR_THETA)
    }
    misses = {theta: np.linalg.norm(points - non_affine.TRUTH, axis=1) for theta, points in ends.items()}
    mirror = np.linalg.norm(ends[non_affine.MIRROR_THETA] - non_affine.MIRROR, axis=1)
    long = replace(base, windows=WINDOWS)
    return ModelSetOutcome(
        n_models=n_models,
        kept=kept,
        guesses=guesses,
        converged=int(np.sum(misses[non_affine.THETA] < CONVERGED)),
        found=int(np.sum(misses[non_affine.MIRROR_THETA] < CONVERGED)),
        mirrored=int(np.sum(mirror < CONVERGED)),
        starts=starts,
        error=settled_error(long.run()),
        shaken=settled_error(replace(long, noise=SHAKEN * non_affine.NOISE).run()),
    )
