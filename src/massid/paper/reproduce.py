"""Runs every experiment that is asked for, and writes figures and results.json."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from massid.errors import BadInputError
from massid.observer.blas import single_threaded
from massid.paper import figures, more_figures
from massid.paper.affine_case import AffineCase, run_affine_case
from massid.paper.comparison_case import ComparisonCase, run_comparison_case
from massid.paper.estimators import EstimatorOutcome, compare_estimators
from massid.paper.humanoid_case import HumanoidCase, run_humanoid_case
from massid.paper.illustration import illustrate
from massid.paper.non_affine_case import NonAffineCase, first_below, run_non_affine_case
from massid.paper.recorded import Check
from massid.paper.setting import Progress, silent
from massid.paper.theory import CHECKS
from massid.result.file import write_json
from massid.systems import non_affine

Part: TypeAlias = Literal["A", "B", "C", "D"]
PARTS: tuple[Part, ...] = ("A", "B", "C", "D")
SHARES = {"A": 0.05, "B": 0.5, "C": 0.1, "D": 0.35}
"""Rough share of the wall time of each part."""


@dataclass
class Reproduction:
    """Everything that was run; None for what was not asked for."""

    a: AffineCase | None = None
    b: NonAffineCase | None = None
    c: ComparisonCase | None = None
    d: HumanoidCase | None = None
    checks: list[Check] = field(default_factory=list)
    estimators: list[EstimatorOutcome] = field(default_factory=list)
    rendered: bool = False
    wall_s: dict[str, float] = field(default_factory=dict)


def reproduce(
    folder: Path,
    parts: tuple[Part, ...] = PARTS,
    walk_s: float = 40.0,
    seed: int = 0,
    progress: Progress = silent,
) -> Reproduction:
    """Run the paper's simulations and write what came of them into a folder.

    Args:
        folder: made if it does not exist.
        parts: sections of V to run.
        walk_s: length of the walk of V-D [s]; 0 for the sample walk.
        seed: of the walk of V-D.
        progress: told the fraction done.

    Raises:
        BadInputError: the folder cannot be made, or the walk is too short.
        FallError: the robot of V-D fell.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInputError(f"Cannot make the folder {folder}: {error.strerror}.") from error
    done, total = 0.0, sum(SHARES[part] for part in parts)
    out = Reproduction()
    for part in parts:
        started = time.perf_counter()

        def within(fraction: float, what: str, before: float = done, share: float = SHARES[part]) -> None:
            progress((before + share * fraction) / total, what)

        within(0.0, f"V-{part}")
        with single_threaded():  # small matrices: BLAS's own threads would only wait for each other
            _RUN[part](out, folder, walk_s, seed, within)
        done += SHARES[part]
        out.wall_s[part] = time.perf_counter() - started
    write_json(results(out), folder / "results.json")
    progress(1.0, "done")
    return out


def results(out: Reproduction) -> dict[str, Any]:
    """The numbers that stand beside the paper's, as plain JSON values; parts that were not run are left out."""
    document: dict[str, Any] = {}
    if out.a:
        default = out.a.outcomes["gauss-newton"]
        document["A"] = {"error": default.error, "iterations": default.iterations}
    if out.b:
        default_b, settling = out.b.default, out.b.settling["gauss-newton"]
        document["B"] = {
            "error": float(default_b.errors(non_affine.TRUTH)[-1]),
            "windows_to_0_01": first_below(default_b),
            "starts_converged": [settling.converged, settling.starts],
        }
    if out.c:
        document["C"] = {
            name: {"models": contender.models, "error": contender.error, "compute_s": contender.compute_s}
            for name, contender in (("guided", out.c.guided), ("dynamic_sampling", out.c.sampling))
        }
    if out.d:
        document["D"] = {
            "windows_to_0_5kg": {name: out.d.errors[name].windows_to_threshold for name in ("gradient", "gauss-newton")}
        }
    if out.checks:
        document["theory"] = [asdict(check) for check in out.checks]
    return document


def _run_a(out: Reproduction, folder: Path, walk_s: float, seed: int, progress: Progress) -> None:
    out.a = run_affine_case()
    progress(0.6, "theory")
    out.checks += [check() for check in CHECKS]
    figures.draw_fig_2(out.a, folder / "fig2.png")


def _run_b(out: Reproduction, folder: Path, walk_s: float, seed: int, progress: Progress) -> None:
    figures.draw_fig_1(illustrate(), folder / "fig1.png")
    out.b = run_non_affine_case(lambda fraction, what: progress(0.9 * fraction, what))
    progress(0.9, "gradient estimators")
    out.estimators = compare_estimators()
    figures.draw_fig_3(out.b, folder / "fig3.png")
    figures.draw_fig_4(out.b, folder / "fig4.png")
    more_figures.draw_paper_direction(out.b.paper, folder / "paper_direction.png")
    more_figures.draw_drift(out.b, folder / "drift.png")


def _run_c(out: Reproduction, folder: Path, walk_s: float, seed: int, progress: Progress) -> None:
    out.c = run_comparison_case(progress)
    more_figures.draw_sampling(out.c, folder / "table1.png")
    more_figures.draw_costs(out.c, folder / "cost.png")


def _run_d(out: Reproduction, folder: Path, walk_s: float, seed: int, progress: Progress) -> None:
    out.d = run_humanoid_case(folder, walk_s, seed, progress=progress)
    out.rendered = figures.draw_fig_5(out.d, folder / "fig5.png")
    figures.draw_fig_6(out.d, folder / "fig6.png")
    out.checks += out.d.checks
    if out.d.drift:
        more_figures.draw_walk_drift(out.d.drift, folder / "walk_drift.png")


_RUN = {"A": _run_a, "B": _run_b, "C": _run_c, "D": _run_d}
