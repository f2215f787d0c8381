"""V-B with the paper's own direction, the gradient: which of the choices that the paper leaves open give its 0.16."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.paper.setting import PAPER_DIRECTION, TIMESTEP_S, WINDOWS, NonAffineRun
from massid.search.guided import SearchOptions
from massid.search.online import score_block
from massid.search.proposal import Proposal, Role
from massid.systems import non_affine
from massid.systems.bank import SystemBank
from massid.systems.non_affine import non_affine_plant, non_affine_system
from massid.systems.online import OnlineRun
from massid.typing import FloatArray

PAPER_ERROR = 0.16
PAPER_GAIN = 0.5
"""k1 = k2 of Eq. (20) [1/s] with which the paper's direction ends nearest to the paper's error."""
PAPER_STEP = 0.03
"""alpha of Section V-B."""
GAINS = (0.2, 0.5, 1.0, 2.0, 5.0, 50.0)
RATES = (0.0, 0.1, 1.0)
SEEDS = 5
GRID_SEEDS = 3
BASE = NonAffineRun(windows=WINDOWS, gain=PAPER_GAIN, search=SearchOptions(direction=PAPER_DIRECTION))
STEP_RULES: tuple[tuple[str, SearchOptions], ...] = (
    ("exact step, units of the scales", BASE.search),
    ("exact step, own units", replace(BASE.search, direction="plain-gradient")),
    ("α = 0.03, own units", replace(BASE.search, direction="plain-gradient", step_size=PAPER_STEP, candidates=0)),
)


@dataclass(frozen=True)
class GradientGrid:
    """Final error of one step rule against k and lambda.

    Attributes:
        rule: the step rule.
        errors: median over `GRID_SEEDS` noise seeds of |p - p*| after 170 s, shape (len(GAINS), len(RATES)).
    """

    rule: str
    errors: FloatArray


@dataclass(frozen=True)
class Variant:
    """One change of the choices with which the paper's direction does best.

    Attributes:
        label: what was changed.
        errors: |p - p*| after 170 s, one for each noise seed, shape (SEEDS,).
    """

    label: str
    errors: FloatArray


@dataclass(frozen=True)
class PaperDirectionCase:
    """V-B with the gradient.

    Attributes:
        run: with k = PAPER_GAIN.
        stiff: with the k of every other run here.
        grids: one for each step rule.
        variants: one change at a time, the first of them none.
        conditions: condition of the Hessian at p* for each of `GAINS`, in units of the scales.
    """

    run: OnlineRun
    stiff: OnlineRun
    grids: tuple[GradientGrid, ...]
    variants: tuple[Variant, ...]
    conditions: tuple[float, ...]


def final_errors(run: NonAffineRun, seeds: int = SEEDS) -> FloatArray:
    """|p - p*| after the last window, one for each noise seed, shape (seeds,)."""
    return np.array([replace(run, seed=seed).run().errors(non_affine.TRUTH)[-1] for seed in range(seeds)])


def hessian_condition(gain: float) -> float:
    """Condition of the Hessian of mu at p* over one window without noise, in units of the scales."""
    system = non_affine_system(gain=gain)
    plant = non_affine_plant(system, np.random.default_rng(0), noise=0.0, timestep_s=TIMESTEP_S)
    plant.run(non_affine.DWELL_S, non_affine.TRUTH)
    block = plant.run(non_affine.DWELL_S, non_affine.TRUTH).block
    offsets = 1e-3 * np.vstack([np.diag(system.space.scale), -np.diag(system.space.scale)])
    proposal = Proposal(
        np.vstack([non_affine.TRUTH, non_affine.TRUTH + offsets]), (Role.CENTRE, *[Role.SAMPLE] * len(offsets))
    )
    bank = SystemBank(system, len(proposal.points), TIMESTEP_S)
    curvature = score_block(bank, proposal, block, non_affine.FORGETTING_RATE).local_quadratic().curvature
    return float(np.linalg.cond(curvature * np.outer(system.space.scale, system.space.scale)))


def one_change_each() -> tuple[Variant, ...]:
    """Change one choice at a time."""
    search = BASE.search
    changes = [
        ("as chosen", BASE),
        ("gradient by least squares", replace(BASE, search=replace(search, gradient="least-squares"))),
        ("gradient from the Gram matrix", replace(BASE, search=replace(search, gradient="gram"))),
        ("α = 1/L, own units", replace(BASE, search=replace(search, direction="safe-gradient", gradient="ransac"))),
        ("radius 0.01", replace(BASE, search=replace(search, radius=0.01))),
        ("radius 0.3", replace(BASE, search=replace(search, radius=0.3))),
        ("dwell time 2 s", replace(BASE, dwell_s=2.0, windows=2 * WINDOWS)),
        ("dwell time 8 s", replace(BASE, dwell_s=8.0, windows=WINDOWS // 2)),
        ("p2 scanned", replace(BASE, search=replace(search, scan=("p2",)))),
        ("18 models", replace(BASE, n_models=18)),
        ("no noise", replace(BASE, noise=0.0)),
    ]
    return tuple(Variant(label, final_errors(run)) for label, run in changes)


def run_paper_direction_case() -> PaperDirectionCase:
    """Run all of it."""
    grids = tuple(GradientGrid(rule, _grid(search)) for rule, search in STEP_RULES)
    return PaperDirectionCase(
        run=BASE.run(),
        stiff=replace(BASE, gain=non_affine.GAIN).run(),
        grids=grids,
        variants=one_change_each(),
        conditions=tuple(hessian_condition(gain) for gain in GAINS),
    )


def _grid(search: SearchOptions) -> FloatArray:
    """Median final errors against k and lambda, shape (len(GAINS), len(RATES))."""
    rows = [
        [final_errors(replace(BASE, gain=gain, forgetting_rate=rate, search=search), GRID_SEEDS) for rate in RATES]
        for gain in GAINS
    ]
    return np.asarray(np.median(rows, axis=2))
