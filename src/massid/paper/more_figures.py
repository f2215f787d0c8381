"""Figures that the paper has not: what its results depend on, what they cost, and its claims about drift."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from massid.paper.comparison_case import ComparisonCase, exponent
from massid.paper.figures import COLOURS, PAPER, page
from massid.paper.non_affine_case import NonAffineCase
from massid.paper.paper_direction import GAINS, PAPER_ERROR, RATES, PaperDirectionCase
from massid.paper.walk_drift import WalkDrift
from massid.systems import non_affine

GRID, GUIDED = COLOURS["gradient"], COLOURS["gauss-newton"]


def draw_paper_direction(case: PaperDirectionCase, path: Path) -> None:
    """Final error of the paper's direction against k, lambda and the step rule."""
    with page(path, 1, 3, (11.5, 4.2), sharey=True) as axes:
        for axis, grid in zip(axes, case.grids, strict=True):
            axis.imshow(np.log10(grid.errors), cmap="RdYlGn_r", vmin=-1.5, vmax=1.0, aspect="auto")
            axis.grid(visible=False)
            for (row, column), error in np.ndenumerate(grid.errors):
                met = error <= PAPER_ERROR
                axis.text(column, row, f"{error:.2f}", ha="center", va="center", weight="bold" if met else "normal")
            axis.set_xticks(range(len(RATES)), [f"{rate:g}" for rate in RATES])
            axis.set_xlabel("λ [1/s]")
            axis.set_title(grid.rule)
        labels = [f"{k:g}  (cond {c:.0f})" for k, c in zip(GAINS, case.conditions, strict=True)]
        axes[0].set_yticks(range(len(GAINS)), labels)
        axes[0].set_ylabel("k [1/s]  (condition of the Hessian)")


def draw_costs(case: ComparisonCase, path: Path) -> None:
    """Models, steps and time against the number of unknowns: guided search and grid."""
    n_p = np.array([cost.n_p for cost in case.costs])
    run = [cost for cost in case.costs if cost.grid_s is not None]
    with page(path, 1, 3, (13.0, 4.0)) as axes:
        axes[0].loglog(n_p, [cost.grid_models for cost in case.costs], "-s", color=GRID, label="grid, 4 per axis")
        axes[0].loglog(n_p, [cost.guided_models for cost in case.costs], "-o", color=GUIDED, label="guided, 3 $n_p$")
        axes[0].set_title("Models")
        steps = [(cost.n_p, cost.total_steps) for cost in case.costs if cost.total_steps is not None]
        slope = exponent([n for n, _ in steps], [total for _, total in steps])
        axes[1].loglog(*zip(*steps, strict=True), "-o", color=GUIDED, label=f"guided: $n_p^{{{slope:.2f}}}$")
        axes[1].loglog(
            n_p,
            [cost.window_steps for cost in case.costs],
            "--o",
            mfc="white",
            color=GUIDED,
            label="of one window: $n_p^{1.00}$",
        )
        axes[1].set_ylim(1e4, 1e6)
        axes[1].set_title("Model steps until 0.01 per copy")
        axes[2].loglog(n_p, [cost.guided_s for cost in case.costs], "-o", color=GUIDED, label="guided")
        per_copy_step = [cost.grid_s / cost.grid_models / cost.n_p for cost in run if cost.grid_s is not None]
        extrapolated = [cost.grid_models * cost.n_p * per_copy_step[-1] for cost in case.costs]
        axes[2].loglog(
            n_p[len(run) - 1 :],
            extrapolated[len(run) - 1 :],
            "--s",
            mfc="white",
            color=GRID,
            label="grid, extrapolated",
        )
        axes[2].loglog([cost.n_p for cost in run], [cost.grid_s for cost in run], "-s", color=GRID, label="grid, run")
        axes[2].set_title("Processor time of one dwell window [s]")
        for axis in axes:
            axis.set_xlabel("unknowns $n_p$ (copies of V-B)")
            axis.set_xticks(n_p, [str(n) for n in n_p])
            axis.minorticks_off()
            axis.legend(fontsize=8)


def draw_sampling(case: ComparisonCase, path: Path) -> None:
    """Table I as curves: error over time of both methods."""
    with page(path, 1, 1, (8.0, 4.0)) as axis:
        for contender, colour, label in (
            (case.guided, GUIDED, "guided, 9 models"),
            (case.sampling, GRID, f"dynamic sampling, 64 models, zoom {case.zoom:g}"),
        ):
            axis.semilogy(contender.run.times_s, contender.run.errors(non_affine.TRUTH), color=colour, label=label)
        axis.plot([170.0], [0.16], "X", color=GUIDED, mec=PAPER, ms=10, label="paper, guided: 0.16")
        axis.plot([170.0], [2.03], "X", color=GRID, mec=PAPER, ms=10, label="paper, dynamic sampling: 2.03")
        axis.set_xlabel("time [s]")
        axis.set_ylabel("$|p - p^*|$")
        axis.set_title("Table I: error over the 170 s")
        axis.legend(fontsize=8)


def draw_drift(case: NonAffineCase, path: Path) -> None:
    """Online against offline while p* drifts, and x1 alone measured."""
    with page(path, 1, 2, (11.0, 3.8)) as axes:
        axes[0].semilogy(case.drift.times_s, case.drift.online, "-o", ms=3, color=GUIDED, label="online")
        axes[0].semilogy(case.drift.times_s, case.drift.offline, "-s", ms=3, color=GRID, label="offline, whole record")
        axes[0].set_title("Parameters that drift")
        axes[1].semilogy(case.output.times_s, case.output.errors(non_affine.TRUTH), "-o", ms=3, color="#2f9e6e")
        axes[1].set_title("V-B with $x_1$ alone measured")
        axes[0].legend(fontsize=8)
        for axis in axes:
            axis.set_xlabel("time [s]")
            axis.set_ylabel("$|p - p^*|$")


def draw_walk_drift(case: WalkDrift, path: Path) -> None:
    """Online against offline while the torso of a walking humanoid grows heavier."""
    with page(path, 1, 2, (11.0, 3.8)) as axes:
        axes[0].plot(case.times_s, case.true_kg, color=PAPER, lw=1, label="true")
        axes[0].plot(case.times_s, case.online_kg, "o", ms=4, color=GUIDED, label="online")
        axes[0].axhline(case.offline_kg, color=GRID, ls="--", label="offline, whole record")
        axes[0].set_ylabel("mass of the torso [kg]")
        axes[0].set_title("The torso is slowly filled")
        axes[1].semilogy(case.times_s, case.online_error_kg, "-o", ms=3, color=GUIDED, label="online")
        axes[1].semilogy(case.times_s, case.offline_error_kg, "-s", ms=3, color=GRID, label="offline, whole record")
        axes[1].set_ylabel("L2 error of seven masses [kg]")
        axes[1].set_title("Error against the masses at that time")
        for axis in axes:
            axis.set_xlabel("time [s]")
            axis.legend(fontsize=8)
