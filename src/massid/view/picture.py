"""One page that shows what was found, for people without a viewer."""

from __future__ import annotations

import warnings
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from massid.model.robot import Robot
from massid.outputs import write_file
from massid.result.result import Result, Status
from massid.score import Score
from massid.search.proposal import Role
from massid.typing import FloatArray
from massid.view import colours
from massid.view.motion import Motion, sample_motion
from massid.view.render import Shot, render_shots
from massid.view.span import plot_end_s
from massid.view.table import format_kg
from massid.view.trace import FLOOR_KG, Trace
from massid.view.words import in_picture
from massid.walk import Walk

WIDTH_IN, PLOTS_HEIGHT_IN, ROBOT_HEIGHT_IN, TITLE_HEIGHT_IN = 12.0, 6.6, 3.9, 0.7
DPI = 150
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#5b6470",
    "axes.labelcolor": "#2b313a",
    "axes.grid": True,
    "grid.color": "#e6e9ee",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "xtick.color": "#5b6470",
    "ytick.color": "#5b6470",
    "legend.frameon": False,
    "text.color": "#1d2229",
}
FRAMES = 4
LABEL_GAP = 0.075
"""Least distance of two labels at the lines' ends, as a share of the axis."""


def write_summary_png(path: Path, walk: Walk, robot: Robot, result: Result, score: Score | None = None) -> None:
    """Draw a result: the robot coloured by its mass errors, the error, the masses, the scores, the contact forces.

    The robot is left out where nothing can render it.

    Args:
        path: the PNG file to write.
        walk: what was identified from.
        robot: the robot with nominal masses.
        result: what was found.
        score: errors against the truth, if it is known.

    Raises:
        BadInputError: the file cannot be written.
        LogError: the log does not match the robot.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    motion, trace = sample_motion(walk, robot), Trace.of(result, score)
    chosen = _chosen_updates(trace)
    pictures = render_shots(
        robot,
        _shots(trace, motion, chosen),
        motion.height_m,
        width=int(DPI * WIDTH_IN / (FRAMES + 0.5)),
        height=int(DPI * 3.3),
    )
    with rc_context(STYLE):
        height = PLOTS_HEIGHT_IN + (ROBOT_HEIGHT_IN if pictures else 0.0)
        figure: Any = Figure(
            figsize=(WIDTH_IN, height),
            dpi=DPI,
            layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.12, hspace=0.03, wspace=0.03),
        )
        FigureCanvasAgg(figure)
        _title(figure, trace, robot, result)
        if pictures:
            upper, lower = figure.subfigures(2, 1, height_ratios=[ROBOT_HEIGHT_IN - TITLE_HEIGHT_IN, PLOTS_HEIGHT_IN])
            _draw_robot(upper, trace, chosen, pictures)
        else:
            lower = figure
        axes = lower.subplots(2, 2, width_ratios=[1.0, 1.0])
        end_s = plot_end_s(trace, motion)
        _draw_headline(axes[0, 0], trace, end_s)
        _draw_masses(axes[0, 1], trace, end_s)
        _draw_scores(axes[1, 0], trace, end_s)
        _draw_forces(axes[1, 1], motion, end_s)
        content = BytesIO()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Glyph .* missing")  # a name in another script has boxes
            figure.savefig(content, format="png", facecolor="white")
    write_file(path, content.getvalue(), make_folder=True)


def _chosen_updates(trace: Trace) -> list[int]:
    """Rows of the trace to draw the robot at: the start, the first updates, the end."""
    last = len(trace.estimate_kg) - 1
    return sorted({0, min(1, last), min(2, last), last})


def _shots(trace: Trace, motion: Motion, chosen: list[int]) -> list[Shot]:
    rgb = colours.error_rgb(trace.relative_error)
    shots = []
    for place, row in enumerate(chosen):
        time_s = trace.update_time_s[row] if trace.online else motion.time_s[-1] * (place + 0.5) / len(chosen)
        pose = motion.qpos[motion.nearest(float(time_s))]
        shots.append(Shot(qpos=pose, link_rgb=dict(zip(trace.links, rgb[row], strict=True))))
    return shots


def _title(figure: Any, trace: Trace, robot: Robot, result: Result) -> None:
    count = len(trace.links)
    masses = "1 link mass" if count == 1 else f"{count} link masses"
    outcome = "" if result.status is Status.CONVERGED else f" ({result.status})"
    figure.suptitle(
        f"{masses} of {in_picture(robot.source)}, weighed from {result.log_s:.3g} s of walking{outcome}",
        x=0.012,
        ha="left",
        fontsize=15,
        fontweight="bold",
    )


def _draw_robot(figure: Any, trace: Trace, chosen: list[int], pictures: list[Any]) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, LogNorm

    axes = figure.subplots(1, len(pictures))
    for axis, row, picture in zip(np.atleast_1d(axes), chosen, pictures, strict=True):
        axis.imshow(picture, interpolation="antialiased")
        axis.set_axis_off()
        axis.set_title(_moment(trace, row), loc="center", fontsize=9.5, fontweight="normal")
    colour_map = ListedColormap(colours.scale_rgb(np.linspace(0.0, 1.0, 256)))
    norm = LogNorm(100 * colours.BEST_ERROR, 100 * colours.WORST_ERROR)
    what = f"{trace.colour_meaning} [% of the link]".replace(", ", ",\n")
    bar = figure.colorbar(
        ScalarMappable(norm, colour_map), ax=list(np.atleast_1d(axes)), shrink=0.72, aspect=22, pad=0.01
    )
    bar.set_ticks([0.3, 1, 3, 10, 30], labels=["≤ 0.3", "1", "3", "10", "≥ 30"])
    bar.minorticks_off()
    bar.set_label(what)
    bar.outline.set_visible(False)


def _moment(trace: Trace, row: int) -> str:
    error = format_kg(float(trace.l2_error_kg[row]))
    tail = f"\nL2 error {error}" if trace.has_truth else ""
    if row == 0:
        return "model file" + tail
    return (f"after window {row}, {trace.update_time_s[row]:.3g} s" if trace.online else f"after pass {row}") + tail


def _axis(trace: Trace) -> FloatArray:
    """Horizontal place of every row of a trace."""
    return trace.update_time_s if trace.online else np.arange(len(trace.update_time_s), dtype=np.float64)


def _finish(axis: Any, trace: Trace, end_s: float) -> None:
    if trace.online:
        axis.set_xlim(0.0, end_s)
        axis.set_xlabel("time in the log [s]")
    else:
        axis.set_xlim(-0.15, len(trace.updates) + 0.5)
        axis.set_xticks(range(len(trace.updates) + 1))
        axis.set_xlabel("passes over the log")


def _steps(axis: Any, x: FloatArray, y: FloatArray, **style: Any) -> None:
    axis.plot(x, y, drawstyle="steps-post", **style)


def _draw_headline(axis: Any, trace: Trace, end_s: float) -> None:
    x = _axis(trace)
    if trace.has_truth:
        values, title = trace.l2_error_kg, "Error of all masses together"
        axis.set_ylabel("L2 mass error [kg]")
    else:
        values, title, x = trace.step_norm_kg, "How far the estimate still wants to move", x[1:]
        axis.set_ylabel("Newton step [kg]")
    values = np.maximum(values, FLOOR_KG)
    hold = [end_s] if trace.online else [len(trace.updates) + 0.5]
    _steps(axis, np.append(x, hold), np.append(values, values[-1]), color=colours.HEADLINE_COLOUR, lw=2.0)
    axis.plot(x, values, "o", color=colours.HEADLINE_COLOUR, ms=5)
    axis.set_yscale("log")
    axis.set_title(title)
    _finish(axis, trace, end_s)


def _draw_masses(axis: Any, trace: Trace, end_s: float) -> None:
    x = _axis(trace)
    end = end_s if trace.online else len(trace.updates) + 0.5
    change = trace.estimate_kg - trace.nominal_kg
    for k in range(len(trace.links)):
        colour = colours.LINK_COLOURS[k % len(colours.LINK_COLOURS)]
        if trace.has_truth:
            axis.axhline(trace.reference_kg[k] - trace.nominal_kg[k], color=colour, lw=0.9, ls=(0, (4, 3)))
        _steps(axis, np.append(x, end), np.append(change[:, k], change[-1, k]), color=colour, lw=2.0)
        half = trace.drawn_half_width_kg[:, k]
        low, high = (np.append(ends, ends[-1]) for ends in (change[:, k] - half, change[:, k] + half))
        axis.fill_between(np.append(x, end), low, high, step="post", color=colour, alpha=0.18, lw=0)
    _finish(axis, trace, end_s)
    low, high = axis.get_ylim()
    places = _spread(change[-1], min(LABEL_GAP, 1.0 / len(trace.links)) * (high - low))
    for k in range(len(trace.links)):
        axis.annotate(
            _label(trace, k),
            (1.0, change[-1, k]),
            xycoords=("axes fraction", "data"),
            xytext=(1.02, places[k]),
            textcoords=("axes fraction", "data"),
            va="center",
            fontsize=8.5,
            color=colours.LINK_COLOURS[k % len(colours.LINK_COLOURS)],
            annotation_clip=False,
        )
    axis.set_ylabel("estimate − model file [kg]")
    bands = "; bands: 95 %" if trace.has_intervals else ""
    axis.set_title("Each link's mass" + ("; dashed: truth" if trace.has_truth else "") + bands)


def _label(trace: Trace, k: int) -> str:
    name = in_picture(trace.links[k])
    if not trace.identifiable[k]:
        return f"{name} not identifiable"
    half = trace.half_width_kg[-1, k]
    interval = f" ±{half:.2f}" if np.isfinite(half) else ""
    return f"{name} {trace.estimate_kg[-1, k]:.2f}{interval} kg"


def _spread(values: FloatArray, gap: float) -> FloatArray:
    """Move labels apart until no two are nearer than a gap; their order stays."""
    order = np.argsort(values)
    places = values[order].astype(np.float64)
    for _ in range(200):
        close = np.maximum(gap - np.diff(places), 0.0)
        if not np.any(close > 1e-9):
            break
        places[:-1] -= 0.5 * close
        places[1:] += 0.5 * close
    spread = np.empty_like(places)
    spread[order] = places
    return spread


def _draw_scores(axis: Any, trace: Trace, end_s: float) -> None:
    x = _axis(trace)[1:]
    jitter = np.random.default_rng(0)
    width = 0.012 * (end_s if trace.online else len(trace.updates))
    for role, size, order in ((Role.SAMPLE, 10, 2), (Role.CANDIDATE, 18, 3), (Role.CENTRE, 42, 4)):
        places, scores = [], []
        for update in range(len(trace.updates)):
            mu = trace.mu(update, role)
            shift = 0.0 if role is Role.CENTRE else width
            places.append(x[update] + jitter.uniform(-shift, shift, len(mu)))
            scores.append(mu)
        colour, label = colours.ROLE_COLOURS[role], _ROLE_LABELS[role]
        together = np.concatenate(scores)
        if len(together):
            axis.scatter(np.concatenate(places), together, s=size, color=colour, label=label, zorder=order, lw=0)
    axis.set_yscale("log")
    axis.set_ylabel("score μ" if trace.errors_scored is None else "score μ per output error")
    axis.set_title(
        f"Scores of all {len(trace.updates[0].mu)} models, window by window"
        if trace.online
        else f"Scores of all {len(trace.updates[0].mu)} models"
    )
    axis.legend(loc="best", handletextpad=0.2, reverse=True)
    _finish(axis, trace, end_s)


def _draw_forces(axis: Any, motion: Motion, end_s: float) -> None:
    shown = motion.time_s <= end_s
    lines: list[Any] = []
    for c in range(len(motion.contact_bodies)):
        colour = colours.FORCE_COLOURS[c % len(colours.FORCE_COLOURS)]
        lines += axis.plot(motion.time_s[shown], motion.vertical_force[shown, c] / 1e3, color=colour, lw=1.5)
    axis.set_xlim(0.0, end_s)
    axis.set_xlabel("time in the log [s]")
    axis.set_ylabel("vertical force [kN]")
    axis.set_title("Contact forces")
    names = [in_picture(name) for name in motion.contact_bodies]
    axis.legend(
        lines, names, loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small"
    )  # beside it: names are long


_ROLE_LABELS: dict[Role, str] = {
    Role.SAMPLE: "samples around it",
    Role.CANDIDATE: "line search",
    Role.CENTRE: "current estimate",
}
