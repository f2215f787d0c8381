from __future__ import annotations

import subprocess
import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.errors import BadInputError
from massid.typing import AnyArray
from massid.view import colours, write_recording
from massid.view.motion import sample_motion
from massid.view.span import update_times_s
from massid.view.table import table_markdown
from massid.view.trace import Trace
from tests.view.conftest import Story


class Recording:
    """What a file holds, read back: rows per entity and timeline, and the columns of one entity."""

    def __init__(self, path: Path) -> None:
        from rerun.chunk import RrdReader

        reader = RrdReader(str(path))
        self.n_blueprints = len(reader.blueprints())
        self.chunks: dict[str, list[Any]] = defaultdict(list)
        for chunk in reader.stream():
            self.chunks[str(chunk.entity_path)].append(chunk)

    def rows(self, entity: str, timeline: str) -> int:
        return sum(chunk.num_rows for chunk in self.chunks[entity] if timeline in chunk.timeline_names)

    def has_component(self, entity: str, component: str) -> bool:
        return any(component in chunk.to_record_batch().schema.names for chunk in self.chunks[entity])

    def static(self, entity: str) -> bool:
        return any(chunk.is_static for chunk in self.chunks[entity])

    def column(self, entity: str, component: str, timeline: str) -> list[Any]:
        values: list[Any] = []
        for chunk in self.chunks[entity]:
            batch = chunk.to_record_batch()
            if timeline in chunk.timeline_names and component in batch.schema.names:
                values += batch.column(component).to_pylist()
        return values

    def times_s(self, entity: str, component: str, timeline: str = "sim_time") -> AnyArray:
        """When the rows of a column are, shape (n,)."""
        times: list[int] = []
        for chunk in self.chunks[entity]:
            batch = chunk.to_record_batch()
            if timeline in chunk.timeline_names and component in batch.schema.names:
                times += batch.column(timeline).cast("int64").to_pylist()
        return 1e-9 * np.array(times)

    def scalars(self, entity: str) -> AnyArray:
        """Values of a series with one value at a time, shape (n,)."""
        return np.array([row[0] for row in self.column(entity, "Scalars:scalars", "sim_time")])

    @property
    def timelines(self) -> set[str]:
        return {name for chunks in self.chunks.values() for chunk in chunks for name in chunk.timeline_names}

    @property
    def moving(self) -> dict[str, AnyArray]:
        """Times of all rows, by entity and component, of whatever changes with time."""
        columns = {
            (entity, component)
            for entity, chunks in self.chunks.items()
            for chunk in chunks
            if not chunk.is_static
            for component in chunk.to_record_batch().schema.names
            if ":" in component
        }
        return {f"{entity} {component}": self.times_s(entity, component) for entity, component in columns}


@pytest.fixture(scope="session")
def online_file(online: Story, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "online.rrd"
    write_recording(path, online.walk, online.robot, online.result, online.score)
    return path


@pytest.fixture(scope="session")
def noisy_recording(noisy: Story, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path = tmp_path_factory.mktemp("recordings") / "noisy.rrd"
    write_recording(path, noisy.walk, noisy.robot, noisy.result, noisy.score)
    return Recording(path)


def rgb_of(column: list[Any]) -> Any:
    packed = np.array([row[0] for row in column], dtype=np.uint32)
    return np.stack([(packed >> shift) & 255 for shift in (24, 16, 8)], axis=-1) / 255.0


def test_it_holds_poses_forces_curves_and_a_blueprint(online: Story, online_file: Path) -> None:
    recording = Recording(online_file)
    assert recording.n_blueprints == 1
    frames, updates = len(online.walk.time_s[::20]), len(online.result.windows)
    for body in ("torso", "l_foot", "r_calf"):
        assert recording.rows(f"/world/robot/{body}", "sim_time") == frames
        assert recording.static(f"/world/robot/{body}/mesh")
    for foot in online.walk.contact_bodies:
        assert recording.rows(f"/world/robot/{foot}/force", "sim_time") == frames
        assert recording.rows(f"/contact/{foot}", "sim_time") == frames
    held = 1  # the last value again at the end of the walk
    assert recording.rows("/headline", "sim_time") == 1 + updates + held
    for link in online.result.estimate_kg:
        assert recording.rows(f"/mass/estimate/{link}", "sim_time") == 1 + updates + held
        assert recording.rows(f"/mass/true/{link}", "sim_time") == 1 + updates + held
    for role in ("centre", "sample", "candidate"):
        assert recording.rows(f"/models/{role}", "sim_time") == updates
    assert recording.rows("/table", "sim_time") == 1 + updates


def test_every_model_of_every_window_has_its_point(online: Story, online_file: Path) -> None:
    recording = Recording(online_file)
    points = [
        value
        for role in ("centre", "sample", "candidate")
        for row in recording.column(f"/models/{role}", "Scalars:scalars", "sim_time")
        for value in row
        if np.isfinite(value)
    ]
    expected = np.log10(np.concatenate([window.mu for window in online.result.windows]))
    assert_allclose(np.sort(points), np.sort(expected), rtol=1e-12)


def test_links_turn_from_bad_to_good(online: Story, online_file: Path) -> None:
    recording = Recording(online_file)
    teal = colours.scale_rgb(np.array(0.0))
    for link in online.result.estimate_kg:
        rgb = rgb_of(recording.column(f"/world/robot/{link}/mesh", "Mesh3D:albedo_factor", "sim_time"))
        distance = np.linalg.norm(rgb - teal, axis=1)
        assert distance[0] > 0.3  # 15 % off
        assert_allclose(distance[-1], 0.0, atol=0.01)  # one step of eight bits in each channel


def test_the_headline_is_the_error_that_was_scored(online: Story, online_file: Path) -> None:
    column = Recording(online_file).column("/headline", "Scalars:scalars", "sim_time")
    expected = np.maximum([online.score.l2_error_initial_kg, *online.score.l2_error_kg], 1e-12)
    assert_allclose([row[0] for row in column][: len(expected)], np.log10(expected), rtol=1e-9)


def test_without_truth_it_shows_steps_and_no_truth(online: Story, tmp_path: Path) -> None:
    path = tmp_path / "no_truth.rrd"
    write_recording(path, online.walk, online.robot, online.result)
    recording = Recording(path)
    assert not [entity for entity in recording.chunks if entity.startswith("/mass/true")]
    column = recording.column("/headline", "Scalars:scalars", "sim_time")
    steps = [np.linalg.norm(window.newton_step) for window in online.result.windows]
    assert_allclose([row[0] for row in column][: len(steps)], np.log10(np.maximum(steps, 1e-12)), rtol=1e-9)


@pytest.mark.parametrize("kind", ["online", "offline", "noisy"])
@pytest.mark.parametrize("scored", [True, False])
def test_nothing_is_empty_wherever_the_cursor_stands(
    kind: str, scored: bool, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """One timeline; what moves, has a colour or is a text is there from its start, and lines go on to its end."""
    story: Story = request.getfixturevalue(kind)
    write_recording(tmp_path / "x.rrd", story.walk, story.robot, story.result, story.score if scored else None)
    recording = Recording(tmp_path / "x.rrd")
    assert recording.timelines == {"sim_time"}
    end_s = sample_motion(story.walk, story.robot).time_s[-1]
    series = {name: times for name, times in recording.moving.items() if "Scalars" in name}
    others = {name: times for name, times in recording.moving.items() if name not in series}
    assert len(others) > 2 * len(story.result.estimate_kg)
    assert all(times[0] == 0.0 for times in others.values())
    late = {name for name, times in series.items() if times[0] > 0.0}
    assert all("/interval/" in name or "/models/" in name or name.startswith("/headline") for name in late)
    unheld = {name for name, times in series.items() if times[-1] < end_s - 1e-6}
    assert all("/models/" in name for name in unheld)
    assert all(times[0] >= 0.0 and times[-1] <= end_s + 1e-6 for times in recording.moving.values())


def test_while_the_walk_plays_once_the_passes_follow_each_other(noisy: Story, noisy_recording: Recording) -> None:
    recording, result = noisy_recording, noisy.result
    passes, link = len(result.windows), next(iter(result.estimate_kg))
    poses = recording.times_s(f"/world/robot/{link}", "Transform3D:translation")
    updates = recording.times_s("/table", "TextDocument:text")
    assert len(updates) == 1 + passes
    assert_allclose(np.diff(np.append(updates, poses[-1])), poses[-1] / (1 + passes), rtol=1e-6)
    assert_allclose(np.diff(poses), 0.02, atol=1e-6)  # the robot walks at the same pace through all of them
    for name in ("/passes StateChange:state", f"/world/robot/{link}/mesh Mesh3D:albedo_factor"):
        assert_allclose(recording.moving[name], updates, atol=0)
    end = [poses[-1]]
    for name in (f"/mass/estimate/{link}", "/headline"):
        assert_allclose(recording.times_s(name, "Scalars:scalars"), np.append(updates, end), atol=1e-9)


def test_colours_lines_and_table_are_those_of_the_pass_in_whose_stretch_they_are(
    noisy: Story, noisy_recording: Recording
) -> None:
    recording, trace = noisy_recording, Trace.of(noisy.result, noisy.score)
    texts = [row[0] for row in recording.column("/table", "TextDocument:text", "sim_time")]
    names = [row[0] for row in recording.column("/passes", "StateChange:state", "sim_time")]
    assert names == ["model file", *(f"pass {k}" for k in range(1, 1 + len(trace.updates)))]
    assert texts == [table_markdown(trace, k, noisy.result, noisy.score) for k in range(len(names))]
    assert all(f"After {names[k]} of" in texts[k] for k in range(1, len(names)))
    for k, link in enumerate(trace.links):
        estimates = np.array([noisy.result.nominal_kg[link], *(one.estimate[k] for one in noisy.result.windows)])
        change = estimates - estimates[0]
        assert_allclose(recording.scalars(f"/mass/estimate/{link}"), [*change, change[-1]], atol=1e-12)
        rgb = rgb_of(recording.column(f"/world/robot/{link}/mesh", "Mesh3D:albedo_factor", "sim_time"))
        assert_allclose(rgb, colours.error_rgb(trace.relative_error[:, k]), atol=0.01)


def test_intervals_stand_around_the_estimates_of_every_pass_that_has_them(
    noisy: Story, noisy_recording: Recording, tmp_path: Path
) -> None:
    windows = tuple(replace(one, std=None) for one in noisy.result.windows)
    path = tmp_path / "last_only.rrd"
    write_recording(path, noisy.walk, noisy.robot, replace(noisy.result, windows=windows), noisy.score)
    last_only = Recording(path)
    for k, link in enumerate(noisy.result.estimate_kg):
        change = noisy_recording.scalars(f"/mass/estimate/{link}")
        times_s = noisy_recording.times_s(f"/mass/estimate/{link}", "Scalars:scalars")
        half = 1.959964 * np.array([one.std[k] for one in noisy.result.windows])
        half = np.append(half, half[-1])
        for end, sign in (("low", -1.0), ("high", 1.0)):
            line = f"/mass/interval/{link}/{end}"
            assert_allclose(noisy_recording.scalars(line), change[1:] + sign * half, rtol=1e-9)
            assert_allclose(last_only.scalars(line), (change[1:] + sign * half)[-2:], rtol=1e-9)
            assert_allclose(noisy_recording.times_s(line, "Scalars:scalars"), times_s[1:], atol=0)
            assert_allclose(last_only.times_s(line, "Scalars:scalars"), times_s[-2:], atol=0)
    together = np.linalg.norm(1.959964 * np.array([one.std for one in noisy.result.windows]), axis=1)
    assert_allclose(noisy_recording.scalars("/headline/interval")[:-1], np.log10(together), rtol=1e-9)


def test_among_intervals_the_truth_is_dotted_over_the_whole_walk(noisy: Story, noisy_recording: Recording) -> None:
    for link, true_kg in noisy.score.true_kg.items():
        path = f"/mass/true/{link}"
        assert_allclose(noisy_recording.scalars(path), true_kg - noisy.result.nominal_kg[link], atol=1e-12)
        assert noisy_recording.has_component(path, "SeriesPoints:marker_sizes")
        times = noisy_recording.times_s(path, "Scalars:scalars")
        assert np.all(np.diff(times) > 0.0)
        assert_allclose(times[[0, -1]], [0.0, sample_motion(noisy.walk, noisy.robot).time_s[-1]], atol=1e-6)


def test_nothing_of_the_truth_is_written_without_a_score(noisy: Story, tmp_path: Path) -> None:
    path = tmp_path / "no_score.rrd"
    write_recording(path, noisy.walk, noisy.robot, noisy.result)
    recording = Recording(path)
    assert not [entity for entity in recording.chunks if entity.startswith("/mass/true")]
    assert not any("true" in row[0] for row in recording.column("/table", "TextDocument:text", "sim_time"))


def test_a_search_of_many_passes_numbers_them_without_words(offline: Story, tmp_path: Path) -> None:
    windows = tuple(replace(offline.result.windows[0], index=k) for k in range(20))
    path = tmp_path / "many.rrd"
    write_recording(path, offline.walk, offline.robot, replace(offline.result, windows=windows))
    states = [row[0] for row in Recording(path).column("/passes", "StateChange:state", "sim_time")]
    assert states == [str(k) for k in range(21)]


def test_online_there_are_no_passes(online: Story, online_file: Path) -> None:
    recording = Recording(online_file)
    assert "/passes" not in recording.chunks
    trace = Trace.of(online.result, online.score)
    expected = [0.0, *(window.time_s for window in online.result.windows)]
    assert_allclose(update_times_s(trace, sample_motion(online.walk, online.robot)), expected, atol=0)
    assert_allclose(recording.times_s("/table", "TextDocument:text"), expected, atol=1e-9)


def test_reruns_own_tool_accepts_it(online_file: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "rerun_cli", "rrd", "verify", str(online_file)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_it_is_small(online_file: Path, online: Story) -> None:
    megabytes_per_second = online_file.stat().st_size / 1e6 / online.walk.duration_s
    assert megabytes_per_second < 15.0 / 20.0  # 15 MB for 20 s, with the meshes


def test_a_path_that_cannot_be_written_is_named(online: Story, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"Cannot write .*: Is a directory"):
        write_recording(tmp_path, online.walk, online.robot, online.result)
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInputError, match=r"Cannot write .*walk\.rrd"):
        write_recording(tmp_path / "file" / "walk.rrd", online.walk, online.robot, online.result)


def test_importing_the_package_loads_neither_rerun_nor_matplotlib() -> None:
    code = "import sys, massid.view, massid.view.viewer; print(sorted({'rerun', 'matplotlib'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
