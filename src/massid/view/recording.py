"""A Rerun recording of a walk and of what was learnt from it, laid out by an embedded blueprint.

Everything lies on one timeline, `sim_time`, the time in the log, so that wherever its cursor stands the robot walks and
no chart is empty. Online, colours, curves and table at time t are those of the estimate after the last complete dwell
window. Offline every update comes from a pass over the whole log and belongs to no moment of it: the passes share the
walk's time out among themselves, one after the other (`massid.view.span`), and a lane above the curves numbers them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from massid.errors import printable
from massid.model.robot import Robot
from massid.outputs import write_file
from massid.result.result import Result
from massid.score import Score
from massid.search.proposal import Role
from massid.typing import AnyArray, FloatArray
from massid.view import colours
from massid.view.layout import make_blueprint
from massid.view.motion import Motion, sample_motion
from massid.view.names import (
    APPLICATION,
    HEADLINE,
    HEADLINE_INTERVAL,
    PASSES,
    SCALE,
    SIM_TIME,
    TABLE,
    TARGET,
    WORLD,
    body_path,
    contact_path,
    estimate_path,
    interval_path,
    models_path,
    truth_path,
)
from massid.view.shapes import body_mesh
from massid.view.span import pass_names, update_times_s
from massid.view.stage import stage
from massid.view.table import table_markdown
from massid.view.trace import FLOOR_KG, Trace
from massid.walk import Walk

FORCE_LENGTH, FORCE_RADIUS = 0.28, 0.009
"""Size of the arrow of a force as large as the robot's weight, in heights of the robot."""
CAMERA_SMOOTHING_S, CAMERA_DROP = 0.6, 0.06
SCALE_PIXELS = (140, 24)
DOTS = 80
"""Points of a dotted line."""


def write_recording(path: Path, walk: Walk, robot: Robot, result: Result, score: Score | None = None) -> None:
    """Write an .rrd file that shows the walk and the identification side by side.

    Args:
        path: the file to write.
        walk: what was identified from.
        robot: the robot with nominal masses.
        result: what was found.
        score: errors against the truth; without it, colours show how far each estimate is from the final one.

    Raises:
        BadInputError: the file cannot be written.
        LogError: the log does not match the robot.
    """
    motion, trace = sample_motion(walk, robot), Trace.of(result, score)
    stream = rr.RecordingStream(APPLICATION)
    memory = stream.memory_recording()  # its writer of files waits for ever on a disk that is full
    stream.send_blueprint(make_blueprint(trace, motion, robot), make_active=False)
    stream.send_recording_name(printable(", ".join(result.sources)))
    writer = _Writer(stream, motion, trace)
    writer.scene(robot)
    writer.curves()
    if not trace.online:
        writer.passes()
    writer.table(result, score)
    content = memory.drain_as_bytes()
    stream.disconnect()
    write_file(path, content, make_folder=True)


class _Writer:
    """Sends one recording, column by column."""

    def __init__(self, stream: rr.RecordingStream, motion: Motion, trace: Trace) -> None:
        self._stream, self._motion, self._trace = stream, motion, trace
        self._times_s = update_times_s(trace, motion)
        self._frames = [rr.TimeColumn(SIM_TIME, duration=motion.time_s)]

    def scene(self, robot: Robot) -> None:
        """The robot, its forces and the floor."""
        self._stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for body in range(1, stage(robot).nbody):
            self._body(robot, body)
        self._camera_target(body=stage(robot).body(robot.root_body).id)
        self._contacts(robot)
        self._colour_scale()

    def curves(self) -> None:
        """The time series: the headline error, the masses, the scores of the models."""
        trace = self._trace
        if trace.has_truth:
            self._line(HEADLINE, _log10(trace.l2_error_kg, FLOOR_KG), "L2 mass error", colours.HEADLINE_COLOUR, 3.0)
        else:
            steps = _log10(trace.step_norm_kg, FLOOR_KG)
            self._line(HEADLINE, steps, "Newton step", colours.HEADLINE_COLOUR, 3.0, first=1)
        self._interval_line(
            HEADLINE_INTERVAL, _log10(trace.together_half_width_kg, FLOOR_KG), "95 %", colours.INTERVAL_COLOUR
        )
        for k, link in enumerate(trace.links):
            colour = colours.LINK_COLOURS[k % len(colours.LINK_COLOURS)]
            change = trace.estimate_kg[:, k] - trace.nominal_kg[k]
            self._line(estimate_path(link), change, link, colour, 2.5)
            self._interval(link, change, trace.drawn_half_width_kg[:, k], colour)
            if trace.has_truth:
                self._truth(link, float(trace.reference_kg[k] - trace.nominal_kg[k]), colour)
        for role in Role:
            self._scores(role)

    def passes(self) -> None:
        """Whose estimates are shown when: a lane of the model file and the passes."""
        names = pass_names(self._trace)
        fills = [colours.hex_rgba8(colours.PASS_COLOURS[row % 2]) for row in range(len(names))]
        self._stream.log(PASSES, rr.StateConfiguration(values=names, colors=fills), static=True)
        self._send(PASSES, rr.StateChange.columns(state=names), list(range(len(names))))

    def table(self, result: Result, score: Score | None) -> None:
        """The table of all links, as it stood after every update."""
        texts = [table_markdown(self._trace, update, result, score) for update in range(len(self._trace.estimate_kg))]
        media = ["text/markdown"] * len(texts)
        self._send(TABLE, rr.TextDocument.columns(text=texts, media_type=media), list(range(len(texts))))

    def _body(self, robot: Robot, body: int) -> None:
        name = stage(robot).body(body).name or f"body_{body}"
        trace = self._trace
        self._pose(body_path(name), self._motion.position[:, body], self._motion.quaternion[:, body])
        mesh = body_mesh(stage(robot), body)
        if mesh is None:
            return
        path = f"{body_path(name)}/mesh"
        self._stream.log(
            path,
            rr.Mesh3D(
                vertex_positions=mesh.vertices,
                vertex_normals=mesh.normals,
                triangle_indices=mesh.triangles,
                vertex_colors=colours.rgba8(colours.tone(mesh.rgba)),
            ),
            static=True,
        )
        if name in trace.links:
            rgb = colours.error_rgb(trace.relative_error[:, trace.links.index(name)])
        else:
            rgb = np.array([colours.NEUTRAL])
        albedo = colours.rgba8(rgb)
        self._send(path, rr.Mesh3D.columns(albedo_factor=albedo), list(range(len(albedo))))

    def _camera_target(self, body: int) -> None:
        """A point that follows the base smoothly; a camera on the base itself would shake with every step."""
        base = self._motion.position[:, body].copy()
        base[:, 2] = np.median(base[:, 2]) - CAMERA_DROP * self._motion.height_m
        width = max(1, round(CAMERA_SMOOTHING_S * len(base) / max(float(self._motion.time_s[-1]), 1e-9)))
        width = min(width, len(base)) | 1
        padded = np.pad(base, ((width // 2, width // 2), (0, 0)), mode="edge")
        kernel = np.full(width, 1.0 / width)
        smooth = np.stack([np.convolve(padded[:, axis], kernel, mode="valid") for axis in range(3)], axis=1)
        self._stream.log(TARGET, rr.Points3D([[0.0, 0.0, 0.0]], radii=[1e-3], colors=[[0, 0, 0, 0]]), static=True)
        self._pose(TARGET, smooth)

    def _pose(self, path: str, position: FloatArray, quaternion: FloatArray | None = None) -> None:
        """Send how a frame moves."""
        self._stream.send_columns(
            path, self._frames, [*rr.Transform3D.columns(translation=position, quaternion=quaternion)]
        )

    def _contacts(self, robot: Robot) -> None:
        motion = self._motion
        scale = FORCE_LENGTH * motion.height_m / (robot.total_mass_kg * 9.81)
        for c, name in enumerate(motion.contact_bodies):
            colour = colours.FORCE_COLOURS[c % len(colours.FORCE_COLOURS)]
            arrow = f"{body_path(name)}/force"
            self._stream.log(
                arrow,
                rr.Arrows3D.from_fields(colors=[colours.hex_rgba8(colour)], radii=[FORCE_RADIUS * motion.height_m]),
                static=True,
            )
            vectors = scale * motion.force[:, c]
            arrows = rr.Arrows3D.columns(vectors=vectors, origins=motion.pressure_point[:, c] - vectors)
            self._stream.send_columns(arrow, self._frames, [*arrows])
            path = contact_path(name)
            self._style(path, name, colour, 2.0, step=False)
            scalars = rr.Scalars.columns(scalars=motion.vertical_force[:, c])
            self._stream.send_columns(path, self._frames, [*scalars])

    def _colour_scale(self) -> None:
        """The scale of the links' colours, as a picture with labels; the viewer has no colour bar of its own."""
        bar = colours.scale_rgb(np.linspace(1.0, 0.0, SCALE_PIXELS[0]))[:, None].repeat(SCALE_PIXELS[1], axis=1)
        self._stream.log(SCALE, rr.Image(colours.rgba8(bar)), static=True)
        height, width = SCALE_PIXELS
        labels = ["30 % or more", "3 %", "0.3 % or less"]
        self._stream.log(
            f"{SCALE}/labels",
            rr.Points2D(
                [[width + 45.0, y] for y in (8.0, 0.5 * height, height - 8.0)],
                labels=labels,
                radii=[0.01] * len(labels),
                colors=[[214, 219, 226, 255]] * len(labels),
                show_labels=True,
            ),
            static=True,
        )

    def _interval(self, link: str, change: FloatArray, half_width: FloatArray, colour: str) -> None:
        """Thin lines at both ends of the 95 % interval; the viewer has no bands."""
        for end, sign in (("low", -1.0), ("high", 1.0)):
            self._interval_line(interval_path(link, end), change + sign * half_width, link, colour)

    def _interval_line(self, path: str, values: FloatArray, name: str, colour: str) -> None:
        """A thin line from the first update on that has an interval, if one has."""
        known = np.flatnonzero(np.isfinite(values))
        if len(known):
            first = int(known[0])
            self._line(path, values[first:], name, colour, 1.2, first=first, opacity=0.75)

    def _truth(self, link: str, change_kg: float, colour: str) -> None:
        """A line at the true mass: thin, or dotted where thin lines are the ends of intervals."""
        path = truth_path(link)
        if not self._trace.has_intervals:
            self._line(path, np.full(len(self._times_s), change_kg), link, colour, 1.0)
            return
        style = rr.SeriesPoints(colors=[colours.hex_rgba8(colour)], names=[printable(link)], marker_sizes=[1.2])
        self._stream.log(path, style, static=True)
        times = rr.TimeColumn(SIM_TIME, duration=np.linspace(0.0, float(self._motion.time_s[-1]), DOTS))
        self._stream.send_columns(path, [times], [*rr.Scalars.columns(scalars=np.full(DOTS, change_kg))])

    def _scores(self, role: Role) -> None:
        """One point per model and window; fewer models than in other windows leave gaps."""
        trace = self._trace
        scores = [_log10(trace.mu(update, role), 0.0) for update in range(len(trace.updates))]
        width = max((len(values) for values in scores), default=0)
        if width == 0:
            return
        path = models_path(role)
        size = 5.0 if role is Role.CENTRE else 3.0
        colour = colours.ROLE_COLOURS[role]
        names = [str(role)] * width
        style = rr.SeriesPoints(
            colors=[colours.hex_rgba8(colour)] * width,
            names=names,
            marker_sizes=[size] * width,
            markers=["Circle"] * width,
        )
        self._stream.log(path, style, static=True)
        table = np.full((len(scores), width), np.nan)
        for row, values in enumerate(scores):
            table[row, : len(values)] = values
        self._send(path, rr.Scalars.columns(scalars=table), list(range(1, 1 + len(table))))

    def _line(
        self, path: str, values: FloatArray, name: str, colour: str, width: float, first: int = 0, opacity: float = 1.0
    ) -> None:
        """Send one value per update; the last one holds until the walk ends."""
        self._style(path, name, colour, width, step=True, opacity=opacity)
        rows = list(range(first, first + len(values)))
        self._send(path, rr.Scalars.columns(scalars=values), rows)
        end_s = float(self._motion.time_s[-1])
        if len(values) and end_s > self._times_s[-1]:
            column = rr.TimeColumn(SIM_TIME, duration=[end_s])
            self._stream.send_columns(path, [column], [*rr.Scalars.columns(scalars=values[-1:])])

    def _style(self, path: str, name: str, colour: str, width: float, step: bool, opacity: float = 1.0) -> None:
        mode = "StepAfter" if step else "Linear"
        style = rr.SeriesLines(
            colors=[colours.hex_rgba8(colour, opacity)],
            names=[printable(name)],
            widths=[width],
            interpolation_mode=mode,
        )
        self._stream.log(path, style, static=True)

    def _send(self, path: str, columns: Any, rows: Sequence[int]) -> None:
        """Send rows that belong to updates: row 0 is the model file, row k + 1 follows update k."""
        times = rr.TimeColumn(SIM_TIME, duration=self._times_s[list(rows)])
        self._stream.send_columns(path, [times], [*columns])


def _log10(values: FloatArray, floor: float) -> AnyArray:
    return np.log10(np.maximum(values, floor)) if floor > 0 else np.log10(values)
