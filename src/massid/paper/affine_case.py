"""V-A run again: Fig. 2, iterations until Eq. (18), and how much they depend on what the paper does not say."""

from __future__ import annotations

from dataclasses import dataclass, replace

from massid.paper.setting import DIRECTION_NAMES, PAPER_DIRECTION, AffineRun
from massid.search.guided import SearchOptions, SearchStatus
from massid.systems import affine
from massid.systems.online import OnlineRun
from massid.typing import FloatArray

SEEDS = 20
OPTIONS = SearchOptions(gradient_tolerance=affine.TERMINATION)


@dataclass(frozen=True)
class AffineOutcome:
    """One run until Eq. (18).

    Attributes:
        iterations: windows until the gradient's norm fell below c_terminate, that one included; None if it never did.
        error: |p - p*| at the end.
        errors: from each window on, shape (1 + n,).
        times_s: shape (1 + n,).
    """

    iterations: int | None
    error: float
    errors: FloatArray
    times_s: FloatArray

    @classmethod
    def of(cls, run: OnlineRun) -> AffineOutcome:
        """Score a run."""
        converged = run.iterations[-1].status is SearchStatus.CONVERGED
        errors = run.errors(affine.TRUTH)
        return cls(len(run.iterations) if converged else None, float(errors[-1]), errors, run.times_s)


@dataclass(frozen=True)
class AffineCase:
    """All of V-A.

    Attributes:
        outcomes: by direction.
        seeds: the paper's direction with other seeds of the sampling: RANSAC and the samples are random.
        sensitivity: what was changed, and the outcome of the paper's direction and of the default.
    """

    outcomes: dict[str, AffineOutcome]
    seeds: tuple[AffineOutcome, ...]
    sensitivity: tuple[tuple[str, AffineOutcome, AffineOutcome], ...]


def run_affine_case() -> AffineCase:
    """Run V-A with every direction, and with other choices where the paper is silent."""
    outcomes = {name: AffineOutcome.of(AffineRun(replace(OPTIONS, direction=name)).run()) for name in DIRECTION_NAMES}
    base = AffineRun(OPTIONS)
    changes = [
        *((f"k = {gain:g} 1/s", replace(base, gain=gain)) for gain in (0.5, 2.0, 5.0, 20.0)),
        *((f"lambda = {rate:g} 1/s", replace(base, forgetting_rate=rate)) for rate in (0.0, 1.0)),
        *((f"dwell time {dwell:g} s", replace(base, dwell_s=dwell)) for dwell in (2.0, 8.0)),
        ("u with half the amplitudes", replace(base, control=(-6.0, 3.0, *affine.INPUT[2:3], 2.0, *affine.INPUT[4:]))),
        ("u with periods 6.3 and 2.1 s", replace(base, control=(-6.0, 6.0, 1.0, 4.0, 3.0))),
        ("u with mean -7", replace(base, control=(-7.0, *affine.INPUT[1:]))),
    ]
    paper = replace(OPTIONS, direction=PAPER_DIRECTION)
    sensitivity = tuple(
        (label, AffineOutcome.of(replace(run, search=paper).run()), AffineOutcome.of(run.run()))
        for label, run in changes
    )
    seeds = tuple(AffineOutcome.of(AffineRun(paper, seed=seed).run()) for seed in range(SEEDS))
    return AffineCase(outcomes, seeds, sensitivity)
