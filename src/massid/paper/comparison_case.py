"""V-C run again: Table I, the zoom factor of dynamic sampling, the mirror minimum, and cost against the unknowns."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.paper.setting import (
    DEFAULT,
    N_MODELS,
    TIMESTEP_S,
    WINDOWS,
    NonAffineRun,
    Progress,
    silent,
)
from massid.search.guided import GuidedSearch
from massid.search.monitoring import Monitoring
from massid.search.online import score_block
from massid.systems import non_affine
from massid.systems.bank import SystemBank
from massid.systems.dynamic_sampling import DynamicSampling
from massid.systems.non_affine import copied_controller, copied_system, non_affine_plant, non_affine_system
from massid.systems.online import OnlineRun, run_online
from massid.systems.plant import Disturbance, Plant
from massid.systems.system import MeasuredBlock

PER_AXIS = 4
ZOOMS = (0.5, 0.6, 0.7, 0.8, 0.9)
COPIES = (1, 2, 3, 4)
LARGEST_GRID_COPIES = 2
"""4^6 = 4096 models are run; 4^9 and 4^12 are extrapolated."""


@dataclass(frozen=True)
class Contender:
    """One column of Table I.

    Attributes:
        models: size of the bank.
        compute_s: processor time of 170 s of the system, plant included.
        error: |p - p*| at the end.
        windows: until the error stays below 0.01; None if it does not.
        run: all of it.
    """

    models: int
    compute_s: float
    error: float
    windows: int | None
    run: OnlineRun

    @classmethod
    def of(cls, models: int, run: OnlineRun) -> Contender:
        """Score a run."""
        errors = run.errors(non_affine.TRUTH)
        return cls(models, run.compute_s, float(errors[-1]), run.windows_until(non_affine.TRUTH, 0.01), run)


@dataclass(frozen=True)
class Zoom:
    """Dynamic sampling with one zoom factor.

    Attributes:
        zoom: the factor.
        mirrored: whether Theta admits p3 < 0.
        error: at the end.
        mirror_distance: distance of the end from the mirror minimum.
    """

    zoom: float
    mirrored: bool
    error: float
    mirror_distance: float


@dataclass(frozen=True)
class Cost:
    """What some copies of V-B take.

    A step of a model of c copies is c steps of V-B: what grows with the system that is simulated, and not with the
    search, is told apart by counting model steps, and by the time of one step of one copy.

    Attributes:
        n_p: number of unknowns.
        guided_models: of the guided search, 3 n_p.
        guided_s: least processor time of one window, plant left out [s].
        guided_windows: until |p - p*| per copy is below 0.01; None if it is not within the run.
        window_steps: model steps of one window of the guided search.
        grid_models: 4^n_p.
        grid_s: processor time of one window of the grid [s]; None where it was not run.
    """

    n_p: int
    guided_models: int
    guided_s: float
    guided_windows: int | None
    window_steps: int
    grid_models: int
    grid_s: float | None

    @property
    def total_steps(self) -> int | None:
        """Model steps until |p - p*| per copy is below 0.01."""
        return None if self.guided_windows is None else self.guided_windows * self.window_steps

    @property
    def copy_step_s(self) -> float:
        """Processor time of one step of one copy in one model [s]."""
        return self.guided_s / (self.window_steps * self.n_p / 3)


def exponent(n_p: Sequence[int], values: Sequence[float]) -> float:
    """The m of values ~ n_p^m, by least squares on logarithms."""
    return float(np.polyfit(np.log(n_p), np.log(values), 1)[0])


@dataclass(frozen=True)
class ComparisonCase:
    """All of V-C."""

    guided: Contender
    sampling: Contender
    zoom: float
    zooms: list[Zoom]
    costs: list[Cost]


def run_sampling(zoom: float, theta: tuple[tuple[float, float], ...] = non_affine.THETA, seed: int = 0) -> OnlineRun:
    """Dynamic sampling on V-B for 170 s."""
    system = non_affine_system(theta=theta)
    sampling = DynamicSampling(system.space, PER_AXIS, zoom)
    plant = non_affine_plant(system, np.random.default_rng([seed, 1]), timestep_s=TIMESTEP_S)
    bank = SystemBank(system, sampling.n_models, TIMESTEP_S)
    return run_online(plant, bank, sampling, WINDOWS, non_affine.DWELL_S, non_affine.FORGETTING_RATE)


def compare_zooms(progress: Progress = silent) -> list[Zoom]:
    """Every zoom factor in both Thetas."""
    rows = []
    for i, zoom in enumerate(ZOOMS):
        progress(i / len(ZOOMS), f"dynamic sampling, zoom {zoom:g}")
        for mirrored, theta in ((False, non_affine.THETA), (True, non_affine.MIRROR_THETA)):
            run = run_sampling(zoom, theta)
            end = run.estimates[-1]
            rows.append(
                Zoom(
                    zoom,
                    mirrored,
                    float(run.errors(non_affine.TRUTH)[-1]),
                    float(np.linalg.norm(end - non_affine.MIRROR)),
                )
            )
    return rows


def measure_costs(windows: int = 8) -> list[Cost]:
    """Independent copies of V-B: models and time of one window, guided search against the grid."""
    return [_cost(copies, windows) for copies in COPIES]


def _cost(copies: int, windows: int) -> Cost:
    system = copied_system(copies)
    n_p = len(system.space)
    noise = Disturbance(np.tile([0.0, non_affine.NOISE], copies), non_affine.HOLD_S)
    plant = Plant(
        system,
        np.tile(non_affine.TRUTH, copies),
        copied_controller(copies),
        np.zeros(system.n_x),
        TIMESTEP_S,
        noise,
        rng=np.random.default_rng([copies, 1]),
    )
    search = GuidedSearch(system.space, 3 * n_p, rng=np.random.default_rng([copies, 2]))
    bank = SystemBank(system, 3 * n_p, TIMESTEP_S)
    bank.restart(plant.run(TIMESTEP_S, search.estimate).block)
    warm_up = plant.run(2.0 * TIMESTEP_S, search.estimate).block
    score_block(bank, search.ask(), warm_up, 0.0)
    spent, errors = [], []
    for _ in range(windows):
        block = plant.run(non_affine.DWELL_S, search.estimate).block
        started = time.process_time()
        search.tell(score_block(bank, search.ask(), block, non_affine.FORGETTING_RATE))
        spent.append(time.process_time() - started)
        errors.append(float(np.linalg.norm(search.estimate - np.tile(non_affine.TRUTH, copies))))
    below = [k + 1 for k, error in enumerate(errors) if error < 0.01 * np.sqrt(copies)]
    grid_s = None
    if copies <= LARGEST_GRID_COPIES:
        sampling = DynamicSampling(system.space, PER_AXIS)
        grid = SystemBank(system, sampling.n_models, TIMESTEP_S)
        started = time.process_time()
        sampling.tell(_score_in_parts(grid, sampling, block))
        grid_s = time.process_time() - started
    return Cost(
        n_p=n_p,
        guided_models=3 * n_p,
        guided_s=float(np.min(spent)),
        guided_windows=below[0] if below else None,
        window_steps=3 * n_p * len(block),
        grid_models=PER_AXIS**n_p,
        grid_s=grid_s,
    )


def _score_in_parts(bank: SystemBank, sampling: DynamicSampling, block: MeasuredBlock) -> Monitoring:
    """Score a large grid part by part: of the Gram matrix only the diagonal is needed, and no errors are kept."""
    proposal = sampling.ask()
    bank.place(proposal.points)
    bank.restart(block)
    mu = np.zeros(bank.n_models)
    part = 100
    for k in range(0, len(block), part):
        piece = MeasuredBlock(
            start=block.start,
            measured=np.ascontiguousarray(block.measured[2 * k : 2 * (k + part) + 1]),
            control=np.ascontiguousarray(block.control[k : k + part]),
            timestep_s=block.timestep_s,
        )
        errors = bank.advance(piece).values
        weight = np.exp(-non_affine.FORGETTING_RATE * block.timestep_s * (len(block) - 1 - k - np.arange(len(piece))))
        mu += np.einsum("nky,nky,k->n", errors, errors, weight * block.timestep_s)
    return Monitoring(proposal, np.diag(mu), np.zeros(bank.n_models, dtype=np.bool_), len(block))


def run_comparison_case(progress: Progress = silent) -> ComparisonCase:
    """Run both methods for 170 s, the zoom factors and the costs."""
    NonAffineRun(windows=1).run()  # compiles what both methods run, so that neither pays for it
    zooms = compare_zooms(lambda fraction, what: progress(0.5 * fraction, what))
    own_theta = [row for row in zooms if not row.mirrored]
    zoom = min(own_theta, key=lambda row: row.error).zoom
    progress(0.6, "Table I")
    guided = Contender.of(N_MODELS, NonAffineRun(windows=WINDOWS, search=DEFAULT).run())
    sampling = Contender.of(PER_AXIS**3, run_sampling(zoom))
    progress(0.8, "cost against the number of unknowns")
    return ComparisonCase(guided, sampling, zoom, zooms, measure_costs())
