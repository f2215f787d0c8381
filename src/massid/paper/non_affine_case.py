"""V-B run again: Fig. 3 and 4, noise seeds, random starts, hold times, drift, and x1 alone measured."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from massid.paper.model_sets import (
    MirrorOutcome,
    ModelSetOutcome,
    compare_mirror_scans,
    compare_model_sets,
    settled_error,
)
from massid.paper.paper_direction import PaperDirectionCase, run_paper_direction_case
from massid.paper.setting import (
    CONVERGED,
    DEFAULT,
    DIRECTION_NAMES,
    N_MODELS,
    THRESHOLD,
    TIMESTEP_S,
    WINDOWS,
    NonAffineRun,
    Progress,
    as_start,
    random_starts,
    silent,
)
from massid.search.directions import make_direction
from massid.search.guided import GuidedSearch, SearchOptions
from massid.search.monitoring import Monitoring
from massid.search.offline import BlockReplay, run_offline
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.systems import non_affine
from massid.systems.bank import SystemBank
from massid.systems.non_affine import non_affine_plant, non_affine_system, output_system
from massid.systems.online import OnlineRun, run_online
from massid.systems.plant import Plant
from massid.typing import FloatArray

STARTS, SEEDS = 30, 8
START_WINDOWS, FIRST_ORDER_WINDOWS = 12, 20
"""Windows that a random start gets with a second-order direction, and with another."""
TARGET_WINDOWS = 5
"""Within these the error shall be below 0.01."""
SHIFTED = (3.4, 4.6, 6.0)
"""Other upper ends of Theta in p2: they move the scan's values off p*."""


@dataclass(frozen=True)
class Settling:
    """Noise seeds and random starts with one direction.

    Attributes:
        final_errors: after 170 s from p0, one for each noise seed, shape (SEEDS,).
        windows: until the error is first below 0.01, one for each seed; None if it never is.
        converged: random starts that ended below `CONVERGED`.
        start_windows: until the error is first below 0.01, one for each converged start.
        starts: how many starts there were.
    """

    final_errors: FloatArray
    windows: tuple[int | None, ...]
    converged: int
    start_windows: tuple[int | None, ...]
    starts: int = STARTS


def first_below(run: OnlineRun, threshold: float = THRESHOLD) -> int | None:
    """Windows until the error is first below a threshold.

    Noise alone puts one window in some hundred above 0.01, so "from when on" would measure the length of the run.
    """
    below = np.flatnonzero(run.errors(non_affine.TRUTH) < threshold)
    return int(below[0]) if len(below) else None


def settle(direction: str, starts: int = STARTS, seeds: int = SEEDS) -> Settling:
    """Noise seeds from p0 and random starts, with one direction."""
    search = replace(DEFAULT, direction=direction)
    seeded = [NonAffineRun(seed=seed, windows=WINDOWS, search=search).run() for seed in range(seeds)]
    windows = START_WINDOWS if make_direction(direction).second_order else FIRST_ORDER_WINDOWS
    runs = [
        NonAffineRun(start=as_start(start), seed=i, windows=windows, search=search).run()
        for i, start in enumerate(random_starts(starts))
    ]
    found = [run for run in runs if run.errors(non_affine.TRUTH)[-1] < CONVERGED]
    return Settling(
        final_errors=np.array([run.errors(non_affine.TRUTH)[-1] for run in seeded]),
        windows=tuple(first_below(run) for run in seeded),
        converged=len(found),
        start_windows=tuple(first_below(run) for run in found),
        starts=starts,
    )


class _NoSearch:
    """Stays at the nominal values, whatever it is told."""

    def __init__(self, space: ParameterSpace) -> None:
        self.estimate = space.nominal

    def ask(self) -> Proposal:
        return Proposal(np.tile(self.estimate, (N_MODELS, 1)), (Role.CENTRE, *[Role.SAMPLE] * (N_MODELS - 1)))

    def tell(self, monitoring: Monitoring) -> None:
        """Learn nothing."""


def run_without_search(windows: int, seed: int = 0) -> OnlineRun:
    """The controller with p0 for ever: the upper half of Fig. 3."""
    system = non_affine_system()
    plant = non_affine_plant(system, np.random.default_rng([seed, 1]), timestep_s=TIMESTEP_S)
    bank = SystemBank(system, N_MODELS, TIMESTEP_S)
    return run_online(plant, bank, _NoSearch(system.space), windows, non_affine.DWELL_S, 0.0, keep_motion=True)


def cramer_rao(hold_s: float, noise: float = non_affine.NOISE, duration_s: float = non_affine.DWELL_S) -> float:
    """Smallest root mean square |p - p*| that an unbiased estimate from one window can have.

    Delta held over h is white noise of density noise^2 h for what moves more slowly; x2' tells p through the
    derivatives of Eq. (19) by p.
    """
    system = non_affine_system()
    plant = non_affine_plant(system, np.random.default_rng(0), noise=0.0, timestep_s=TIMESTEP_S)
    plant.run(duration_s, non_affine.TRUTH)
    x1, x2 = plant.run(duration_s, non_affine.TRUTH).states.T
    _, p2, p3 = non_affine.TRUTH
    slope = np.stack([x1 + np.sin(x1), 14.0 * x2 * np.cos(p2 * x2), x1 * np.exp(p3 * x1)], axis=1)
    information = slope.T @ slope * TIMESTEP_S / (noise**2 * hold_s)
    return float(np.sqrt(np.trace(np.linalg.inv(information))))


def hold_times(holds_s: tuple[float, ...] = (1e-3, 1e-2, 0.1)) -> list[tuple[float, float, float]]:
    """Noise hold time [s], settled root mean square error, Cramer-Rao bound of one window."""
    return [
        (hold, settled_error(NonAffineRun(hold_s=hold, windows=WINDOWS).run()), cramer_rao(hold)) for hold in holds_s
    ]


def sensitivity() -> list[tuple[str, int | None, float]]:
    """What was changed, windows until 0.01, settled root mean square error: for the default search from p0."""
    base = NonAffineRun(windows=30)
    changes = [("as chosen", base)]
    changes += [(f"k = {gain:g} 1/s", replace(base, gain=gain)) for gain in (2.0, 10.0, 200.0)]
    changes += [(f"lambda = {rate:g} 1/s", replace(base, forgetting_rate=rate)) for rate in (0.0, 0.5, 2.0)]
    changes += [
        (f"dwell time {dwell:g} s", replace(base, dwell_s=dwell, windows=round(120.0 / dwell)))
        for dwell in (1.0, 2.0, 8.0)
    ]
    changes += [(f"radius {r:g}", replace(base, search=replace(DEFAULT, radius=r))) for r in (0.01, 0.3)]
    changes += [("no scan", replace(base, search=SearchOptions()))]
    changes += [("p2 alone scanned", replace(base, search=replace(DEFAULT, scan=("p2",))))]
    changes += [("sampling ball", replace(base, search=replace(DEFAULT, sampling="ball")))]
    changes += [("Theta with p3 < 0", replace(base, theta=non_affine.MIRROR_THETA))]
    rows = []
    for label, setting in changes:
        run = setting.run()
        rows.append((label, first_below(run), settled_error(run)))
    return rows


def run_from_output(windows: int = 20, seed: int = 0) -> OnlineRun:
    """V-B with x1 alone measured: an observer at the running estimate recovers x2."""
    system = output_system()
    plant = non_affine_plant(system, np.random.default_rng([seed, 1]), timestep_s=TIMESTEP_S)
    search = GuidedSearch(system.space, N_MODELS, DEFAULT, np.random.default_rng([seed, 2]))
    bank = SystemBank(system, N_MODELS, TIMESTEP_S)
    return run_online(plant, bank, search, windows, non_affine.DWELL_S, non_affine.FORGETTING_RATE)


@dataclass(frozen=True)
class Drift:
    """Online against offline while p1 and p3 drift.

    Attributes:
        times_s: end of each window, shape (n,).
        online: error of each window's estimate against p* at its end, shape (n,).
        offline: error of the one estimate from the whole record, against p* at the same times, shape (n,).
    """

    times_s: FloatArray
    online: FloatArray
    offline: FloatArray


def drift(windows: int = 25, rate: FloatArray | None = None) -> Drift:
    """Let p* drift slowly (Section IV-B says that online identification may follow)."""
    speed = np.array([-0.02, 0.0, 0.002]) if rate is None else rate

    def truth(time_s: float) -> FloatArray:
        return np.asarray(non_affine.TRUTH + speed * time_s, dtype=np.float64)

    system = non_affine_system()
    template = non_affine_plant(system, np.random.default_rng(0), timestep_s=TIMESTEP_S)
    disturbance = non_affine.disturbance(non_affine.NOISE, non_affine.HOLD_S)
    plant = Plant(
        system, truth, template.controller, np.zeros(2), TIMESTEP_S, disturbance, rng=np.random.default_rng([0, 1])
    )
    search = GuidedSearch(system.space, N_MODELS, DEFAULT, np.random.default_rng([0, 2]))
    bank = SystemBank(system, N_MODELS, TIMESTEP_S)
    run = run_online(
        plant,
        bank,
        search,
        windows,
        non_affine.DWELL_S,
        non_affine.FORGETTING_RATE,
        keep_blocks=True,
    )
    again = GuidedSearch(system.space, N_MODELS, DEFAULT, np.random.default_rng([0, 2]))
    run_offline([BlockReplay(bank, run.blocks, non_affine.FORGETTING_RATE)], again, START_WINDOWS)
    times = run.times_s[1:]
    truths = np.array([truth(time) for time in times])
    return Drift(
        times_s=times,
        online=np.linalg.norm(run.estimates[1:] - truths, axis=1),
        offline=np.linalg.norm(again.estimate - truths, axis=1),
    )


@dataclass(frozen=True)
class ScanOutcome:
    """Random starts with one way to scan.

    Attributes:
        label: what is scanned, and Theta.
        converged: starts that found p*.
        in_time: starts whose error was below 0.01 within five windows.
        worst: most windows that a converged start took; None if one never was below 0.01.
        starts: how many there were.
    """

    label: str
    converged: int
    in_time: int
    worst: int | None
    starts: int


def compare_scans(starts: int = STARTS) -> list[ScanOutcome]:
    """Random starts with and without scans; and with Thetas in which no scanned value is near p*."""
    rows = []
    for label, scan in (("nothing", ()), ("p2", ("p2",)), ("p2, p3", ("p2", "p3"))):
        rows.append(_scan_outcome(label, scan, non_affine.THETA, starts))
    for upper in SHIFTED:
        theta = (non_affine.THETA[0], (0.0, upper), non_affine.THETA[2])
        rows.append(_scan_outcome(f"p2, p3; p2 in [0, {upper:g}]", ("p2", "p3"), theta, starts))
    return rows


def _scan_outcome(
    label: str, scan: tuple[str, ...], theta: tuple[tuple[float, float], ...], starts: int
) -> ScanOutcome:
    runs = [
        NonAffineRun(
            start=as_start(start), seed=i, windows=START_WINDOWS, search=replace(DEFAULT, scan=scan), theta=theta
        ).run()
        for i, start in enumerate(random_starts(starts, theta))
    ]
    reached = [first_below(run) for run in runs if run.errors(non_affine.TRUTH)[-1] < CONVERGED]
    known = [windows for windows in reached if windows is not None]
    return ScanOutcome(
        label=label,
        converged=len(reached),
        in_time=sum(windows <= TARGET_WINDOWS for windows in known),
        worst=max(known) if known and len(known) == len(reached) else None,
        starts=starts,
    )


@dataclass(frozen=True)
class NonAffineCase:
    """All of V-B."""

    default: OnlineRun
    paper: PaperDirectionCase
    without: OnlineRun
    settling: dict[str, Settling]
    holds: list[tuple[float, float, float]]
    sensitivity: list[tuple[str, int | None, float]]
    scans: list[ScanOutcome]
    model_sets: list[ModelSetOutcome]
    mirror_scans: list[MirrorOutcome]
    output: OnlineRun
    drift: Drift


def run_non_affine_case(progress: Progress = silent) -> NonAffineCase:
    """Run V-B in every way."""
    settling = {}
    for i, name in enumerate(DIRECTION_NAMES):
        progress(0.5 * i / len(DIRECTION_NAMES), f"V-B, {name}")
        settling[name] = settle(name)
    progress(0.5, "V-B, the paper's direction")
    paper = run_paper_direction_case()
    progress(0.75, "V-B, sizes of the model set")
    model_sets = compare_model_sets()
    progress(0.9, "V-B, choices")
    return NonAffineCase(
        default=NonAffineRun(windows=WINDOWS, keep_motion=True).run(),
        paper=paper,
        without=run_without_search(WINDOWS),
        settling=settling,
        holds=hold_times(),
        sensitivity=sensitivity(),
        scans=compare_scans(),
        model_sets=model_sets,
        mirror_scans=compare_mirror_scans(),
        output=run_from_output(),
        drift=drift(),
    )
