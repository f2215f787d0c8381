"""Is a larger ModelSet more robust to disturbance and noise, as Section III says? Banks of several sizes on V-B."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.paper.setting import CONVERGED, N_MODELS, SETTLED, WINDOWS, NonAffineRun, as_start, random_starts
from massid.search.guided import SearchOptions
from massid.systems import non_affine
from massid.systems.online import OnlineRun
from massid.typing import FloatArray

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


@dataclass(frozen=True)
class MirrorOutcome:
    """Random starts in a Theta that admits p3 < 0, with a scan.

    Attributes:
        n_models: size of the bank.
        scan: the parameters that are scanned.
        found: starts that found p*.
        mirrored: starts that found the mirror minimum.
        starts: how many there were.
    """

    n_models: int
    scan: tuple[str, ...]
    found: int
    mirrored: int
    starts: int


def settled_error(run: OnlineRun) -> float:
    """Root mean square error over the windows after the first few."""
    return float(np.sqrt(np.mean(run.errors(non_affine.TRUTH)[SETTLED:] ** 2)))


def compare_model_sets(starts: int = STARTS) -> list[ModelSetOutcome]:
    """Banks of several sizes; with kept models; with further guesses; and with both."""
    return [_outcome(*size, starts) for size in SIZES]


def _outcome(n_models: int, kept: int, guesses: int, starts: int) -> ModelSetOutcome:
    search = SearchOptions(kept=kept, candidates=max(SearchOptions().candidates, guesses - 1))
    base = NonAffineRun(search=search, n_models=n_models, guesses=guesses)
    inside = _ends(base, non_affine.THETA, starts)
    mirror = _ends(base, non_affine.MIRROR_THETA, starts)
    long = replace(base, windows=WINDOWS)
    return ModelSetOutcome(
        n_models=n_models,
        kept=kept,
        guesses=guesses,
        converged=_count_near(inside, non_affine.TRUTH),
        found=_count_near(mirror, non_affine.TRUTH),
        mirrored=_count_near(mirror, non_affine.MIRROR),
        starts=starts,
        error=settled_error(long.run()),
        shaken=settled_error(replace(long, noise=SHAKEN * non_affine.NOISE).run()),
    )


def compare_mirror_scans(starts: int = STARTS) -> list[MirrorOutcome]:
    """Banks of several sizes that scan p2, or p2 and p3, where Theta admits p3 < 0."""
    rows = []
    for scan in (("p2",), ("p2", "p3")):
        for n_models in (N_MODELS, 18, 36):
            base = NonAffineRun(search=SearchOptions(scan=scan), n_models=n_models)
            ends = _ends(base, non_affine.MIRROR_THETA, starts)
            found, mirrored = (_count_near(ends, point) for point in (non_affine.TRUTH, non_affine.MIRROR))
            rows.append(MirrorOutcome(n_models, scan, found, mirrored, starts))
    return rows


def _ends(base: NonAffineRun, theta: tuple[tuple[float, float], ...], starts: int) -> FloatArray:
    """Where random starts in Theta end, shape (starts, 3)."""
    return np.array(
        [
            replace(base, start=as_start(start), seed=i, windows=START_WINDOWS, theta=theta).run().estimates[-1]
            for i, start in enumerate(random_starts(starts, theta))
        ]
    )


def _count_near(points: FloatArray, place: FloatArray) -> int:
    return int(np.sum(np.linalg.norm(points - place, axis=1) < CONVERGED))
