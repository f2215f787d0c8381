"""Figures 1 to 6 redrawn, each with the paper's numbers in it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from massid.outputs import write_file
from massid.paper.affine_case import AffineCase
from massid.paper.humanoid_case import THRESHOLD_KG, HumanoidCase
from massid.paper.illustration import TRUTH as ILLUSTRATED_TRUTH
from massid.paper.illustration import Illustration
from massid.paper.non_affine_case import NonAffineCase
from massid.paper.paper_direction import PAPER_ERROR, PAPER_GAIN
from massid.systems import affine, non_affine
from massid.systems.online import OnlineRun
from massid.typing import FloatArray

DPI = 150
COLOURS = {
    "gauss-newton": "#1664c0",
    "levenberg-marquardt": "#33a5d6",
    "gradient": "#d9480f",
    "plain-gradient": "#f0a830",
    "heavy-ball": "#8c5bd6",
    "adam": "#2f9e6e",
    "bfgs": "#7a828e",
}
PAPER = "#111418"
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e9ee",
    "axes.axisbelow": True,
    "legend.frameon": False,
}
FLOOR = 1e-12
"""Errors below this are rounding."""


@contextmanager
def page(path: Path, rows: int, columns: int, size: tuple[float, float], **share: Any) -> Iterator[Any]:
    """A figure with axes, written when it is done."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(rows, columns, figsize=size, constrained_layout=True, **share)
        try:
            yield axes
            content = BytesIO()
            figure.savefig(content, format="png", dpi=DPI)
        finally:
            plt.close(figure)
    write_file(path, content.getvalue())


def draw_fig_1(case: Illustration, path: Path) -> None:
    """Sampling, direction, line search over contours of mu."""
    titles = ("(a) the estimate", "(b) local sampling", "(c) search direction", "(d) line search")
    with page(path, 1, 4, (14.0, 3.9), sharey=True) as axes:
        for panel, (axis, title) in enumerate(zip(axes, titles, strict=True)):
            axis.contour(case.p1, case.p3, np.log10(case.mu + 1e-6), levels=18, cmap="Greys_r", linewidths=0.8)
            axis.plot(*ILLUSTRATED_TRUTH, "*", color=PAPER, markersize=13, label="p*")
            if panel >= 1:
                axis.plot(*case.points[1:].T, "o", color="#7d9cc0", markersize=5, label="models")
            if panel >= 2:
                step = -case.gradient * np.array([25.0, 1.0])
                step *= 1.2 / np.linalg.norm(step / np.array([2.5, 1.0]))
                axis.annotate(
                    "",
                    case.points[0] + step,
                    case.points[0],
                    arrowprops={"arrowstyle": "->", "color": "#d9480f", "lw": 2},
                )
            if panel == 3:
                axis.plot(*case.path.T, "-o", color="#d9480f", markersize=4, lw=1, label="next windows")
                axis.plot(*case.estimate, "o", color="#e5397f", markersize=8, label="$p_i$")
            axis.plot(*case.points[0], "o", color="#1664c0", markersize=8, label="$p_{i-1}$")
            axis.set_title(title)
            axis.set_xlabel("$p_1$")
            axis.grid(visible=False)
            axis.set_xlim(case.p1[0], case.p1[-1])
            axis.set_ylim(case.p3[0], case.p3[-1])
        axes[0].set_ylabel("$p_3$")
        axes[1].legend(loc="lower left", fontsize=8)
        axes[3].legend(loc="lower left", fontsize=8)


def draw_fig_2(case: AffineCase, path: Path) -> None:
    """V-A: error over time for every direction."""
    with page(path, 1, 1, (8.0, 4.4)) as axis:
        for name, outcome in case.outcomes.items():
            same = name == "plain-gradient"  # all scales are equal, so the metrics are
            axis.semilogy(
                outcome.times_s,
                np.maximum(outcome.errors, FLOOR),
                "--" if same else "-o",
                ms=3,
                color=COLOURS[name],
                label=f"{name} (as gradient)" if same else name,
            )
        axis.plot([36.0], [0.11], "X", color=PAPER, markersize=11, label="paper: 9th iteration, 0.11")
        axis.set_ylim(1e-10, 60.0)
        axis.set_xlim(0.0, 80.0)
        axis.set_xlabel("time [s]")
        axis.set_ylabel("$|p - p^*|$")
        axis.set_title("Fig. 2: V-A until $|\\nabla\\mu| < 0.3$")
        axis.legend(fontsize=8)


def draw_fig_3(case: NonAffineCase, path: Path) -> None:
    """V-B: tracking error without and with the search."""
    with page(path, 2, 1, (8.0, 5.2), sharex=True) as axes:
        for axis, run, title in (
            (axes[0], case.without, "(a) without the search"),
            (axes[1], case.default, "(b) with the search"),
        ):
            axis.plot(run.motion_times_s, tracking_error(run), color="#1664c0", lw=0.8)
            axis.set_title(f"Fig. 3 {title}")
            axis.set_ylabel("$x_1 - x_{des}$")
        limit = 1.1 * max(float(np.abs(tracking_error(case.without)).max()), 1e-6)
        for axis in axes:
            axis.set_ylim(-limit, limit)
            axis.set_xlim(0.0, 60.0)
        axes[1].set_xlabel("time [s]")


def tracking_error(run: OnlineRun) -> FloatArray:
    """x1 - x_des over a run of V-B."""
    return np.asarray(run.motion[:, 0] - non_affine.desired(run.motion_times_s), dtype=np.float64)


def draw_fig_4(case: NonAffineCase, path: Path) -> None:
    """V-B: error over time."""
    with page(path, 1, 1, (8.0, 4.4)) as axis:
        for run, name, label in (
            (case.default, "gauss-newton", "ours: gauss-newton, p2 and p3 scanned"),
            (case.paper.run, "gradient", f"the paper's direction: gradient, k = {PAPER_GAIN:g} 1/s"),
            (case.paper.stiff, "plain-gradient", f"the same, k = {non_affine.GAIN:g} 1/s"),
        ):
            axis.semilogy(run.times_s, run.errors(non_affine.TRUTH), "-o", ms=3, color=COLOURS[name], label=label)
        axis.axhline(PAPER_ERROR, color=PAPER, ls="--", lw=1, label="paper's final error, 0.16")
        bound = case.holds[0][2]
        axis.axhline(bound, color="#7a828e", ls=":", lw=1, label=f"Cramér-Rao bound of one window, {bound:.4f}")
        axis.set_xlabel("time [s]")
        axis.set_ylabel("$|p - p^*|$")
        axis.set_title("Fig. 4: V-B, noise held 1 ms, σ = 0.1")
        axis.legend(fontsize=8, loc="center right", bbox_to_anchor=(1.0, 0.56))


def draw_fig_5(case: HumanoidCase, path: Path, shots: int = 6) -> bool:
    """Snapshots of one step of the walk; a stick figure where nothing can render.

    Returns:
        Whether they were rendered.
    """
    from massid.view.motion import sample_motion
    from massid.view.render import Shot, render_shots

    motion = sample_motion(case.walk, case.robot)
    frames = _one_step(motion.vertical_force[:, 0], shots)
    blue = {link: np.array([0.29, 0.56, 0.89]) for link in case.links}
    shown = [Shot(motion.qpos[frame], blue) for frame in frames]
    pictures = render_shots(case.robot, shown, motion.height_m, 460, 620)
    parents = case.robot.model.body_parentid
    with page(path, 1, shots, (13.0, 3.7)) as axes:
        for i, axis in enumerate(axes):
            axis.grid(visible=False)
            axis.set_axis_off()
            if pictures:
                axis.imshow(pictures[i])
            else:
                places = motion.position[frames[i]]
                for body in range(2, len(places)):
                    axis.plot(*places[[parents[body], body]][:, [0, 2]].T, "-o", ms=3, color="#1664c0")
                axis.set_aspect("equal")
            axis.set_title(f"{motion.time_s[frames[i]]:.2f} s", fontsize=9, fontweight="normal")
    return bool(pictures)


def _one_step(force_n: FloatArray, shots: int) -> list[int]:
    """Frames spread over one step: from one contact of a foot to its next."""
    loaded = force_n > 0.05 * force_n.max()
    touches = np.flatnonzero(loaded[1:] & ~loaded[:-1])
    strides = np.diff(touches)
    longest = int(np.argmax(strides[1:])) + 1 if len(strides) > 1 else 0  # the first begins with standing still
    first, last = (touches[longest], touches[longest + 1]) if len(strides) else (0, len(loaded) - 1)
    return [int(frame) for frame in np.linspace(first, last, shots)]


def draw_fig_6(case: HumanoidCase, path: Path) -> None:
    """V-D: L2 mass error over time, the paper's direction and ours."""
    with page(path, 1, 1, (8.0, 4.4)) as axis:
        for name, errors in case.errors.items():
            axis.semilogy(errors.times_s, np.maximum(errors.l2_kg, FLOOR), color=COLOURS[name], label=name, lw=1.6)
        axis.axhline(
            THRESHOLD_KG, color=PAPER, ls="--", lw=1, label="paper: below 0.5 kg after more than 20 iterations"
        )
        axis.set_ylim(1e-13, 60.0)
        axis.set_xlabel(f"time [s] (a window every {case.dwell_s:g} s)")
        axis.set_ylabel("L2 mass error [kg]")
        axis.set_title("Fig. 6: seven masses of a walking humanoid, 24 models")
        axis.legend(fontsize=8)


def initial_affine_error() -> float:
    """21.95; the paper says 21.9."""
    return float(np.linalg.norm(affine.START - affine.TRUTH))
