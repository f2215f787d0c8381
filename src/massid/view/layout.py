"""Where everything stands in the viewer's window."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from massid.errors import printable
from massid.model.robot import Robot
from massid.search.proposal import Role
from massid.view.motion import Motion
from massid.view.names import FORCES, HEADLINE, PASSES, SCALE, SIM_TIME, TABLE, TARGET, WORLD
from massid.view.span import pass_names, plot_end_s
from massid.view.trace import Trace

BACKGROUND = (20, 23, 29)
CAMERA_DIRECTION = (1.08, -0.95, 0.23)
"""From the base to the camera, in heights of the robot."""
LEGEND_SHARE, LETTER_SHARE = 0.05, 0.0072
"""Width of a plot's legend and of a letter in it, in widths of the plot."""


def make_blueprint(trace: Trace, motion: Motion, robot: Robot) -> rrb.Blueprint:
    """The robot on the left with its table, the curves on the right."""
    headline = "L2 mass error [kg], log10" if trace.has_truth else "Newton step [kg], log10"
    if trace.has_intervals:
        headline += "; thin: 95 % intervals together"
    legend = rrb.PlotLegend(corner=rrb.Corner2D.RightTop)
    axis = _plot_axis(trace, motion)
    error = rrb.TimeSeriesView(
        origin=f"/{HEADLINE}", name=headline, axis_x=axis, plot_legend=rrb.PlotLegend(visible=False)
    )
    masses = rrb.TimeSeriesView(
        origin="/mass",
        name="Estimate minus model file [kg]" + _other_lines(trace),
        axis_x=axis,
        plot_legend=legend,
    )
    models = rrb.TimeSeriesView(
        origin="/models",
        name=f"Score mu of every model{'' if trace.errors_scored is None else ' per output error'}, log10",
        axis_x=axis,
        axis_y=_score_axis(trace),
        plot_legend=legend,
    )
    forces = rrb.TimeSeriesView(origin=f"/{FORCES}", name="Vertical contact force [N]", axis_x=axis, plot_legend=legend)
    table = rrb.Horizontal(
        rrb.TextDocumentView(origin=f"/{TABLE}", name="Masses"),
        rrb.Spatial2DView(
            origin=f"/{SCALE}",
            name="Colour of a link",
            background=rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=BACKGROUND),
            visual_bounds=rrb.VisualBounds2D(x_range=[-30, 190], y_range=[-15, 155]),
        ),
        column_shares=[1.9, 1],
    )
    views, shares = [error, masses, models, forces], [3.0, 4.0, 3.0, 2.4]
    if not trace.online:
        name = "Along the walk: estimates after each pass over the log"
        if pass_names(trace)[0] == "0":
            name += "; 0: model file"
        passes = rrb.StateTimelineView(origin=f"/{PASSES}", name=name, time_view=axis)
        views, shares = [passes, *views], [1.3, *shares]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                _scene(trace, motion, robot), table, row_shares=[1.0 - _table_share(trace), _table_share(trace)]
            ),
            rrb.Vertical(*views, row_shares=shares),
            column_shares=[1.1, 1],
        ),
        rrb.TopPanel(state="expanded"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(
            state="collapsed",
            timeline=SIM_TIME,
            play_state="playing",
            loop_mode="all",
        ),
        auto_views=False,
        auto_layout=False,
    )


def _scene(trace: Trace, motion: Motion, robot: Robot) -> rrb.Spatial3DView:
    target = motion.position[0, robot.model.body(robot.root_body).id]
    position = target + motion.height_m * np.array(CAMERA_DIRECTION)
    return rrb.Spatial3DView(
        origin=f"/{WORLD}",
        name=f"{printable(robot.source)}: colour shows each link's {trace.colour_meaning}",
        background=rrb.Background(kind=rrb.BackgroundKind.SolidColor, color=BACKGROUND),
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5, color=[255, 255, 255, 28], stroke_width=1.0),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital, position=position, look_target=target, tracking_entity=f"/{TARGET}"
        ),
    )


def _other_lines(trace: Trace) -> str:
    """What the thin and the dotted lines among the masses are."""
    if trace.has_intervals:
        return "; thin: 95 % interval" + (", dotted: truth" if trace.has_truth else "")
    return "; thin: truth" if trace.has_truth else ""


def _plot_axis(trace: Trace, motion: Motion) -> rrb.TimeAxis:
    boundary, end_s = rr.TimeRangeBoundary.absolute, plot_end_s(trace, motion)
    if not trace.online:
        end_s /= 1.0 - _legend_share(trace)
    return rrb.TimeAxis(view_range=rr.TimeRange(start=boundary(seconds=0.0), end=boundary(seconds=end_s)))


def _legend_share(trace: Trace) -> float:
    """Share of a plot's width that the links' legend takes: offline, the last estimates end where it begins."""
    return min(0.3, LEGEND_SHARE + LETTER_SHARE * max((len(link) for link in trace.links), default=0))


def _score_axis(trace: Trace) -> rrb.ScalarAxis | None:
    scores = [trace.mu(update, role) for update in range(len(trace.updates)) for role in Role]
    values = np.log10(np.concatenate(scores)) if scores else np.empty(0)
    if not len(values):
        return None
    spread = max(float(np.ptp(values)), 0.1)
    margin = min(0.5, 0.5 * spread) + 0.06 * spread
    return rrb.ScalarAxis(range=(float(values.min()) - margin, float(values.max()) + margin))


def _table_share(trace: Trace) -> float:
    """Share of the window's height that lets the whole table be read, at most half of it."""
    return min(0.5, 0.1 + 0.0265 * (1 + len(trace.links)))
