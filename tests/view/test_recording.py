from __future__ import annotations

import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.errors import BadInputError
from massid.view import colours, write_recording
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

    def static(self, entity: str) -> bool:
        return any(chunk.is_static for chunk in self.chunks[entity])

    def column(self, entity: str, component: str, timeline: str) -> list[Any]:
        values: list[Any] = []
        for chunk in self.chunks[entity]:
            batch = chunk.to_record_batch()
            if timeline in chunk.timeline_names and component in batch.schema.names:
                values += batch.column(component).to_pylist()
        return values


@pytest.fixture(scope="session")
def online_file(online: Story, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recordings") / "online.rrd"
    write_recording(path, online.walk, online.robot, online.result, online.score)
    return path


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


def test_offline_updates_have_a_timeline_of_their_own(offline: Story, tmp_path: Path) -> None:
    path = tmp_path / "offline.rrd"
    write_recording(path, offline.walk, offline.robot, offline.result, offline.score)
    recording = Recording(path)
    updates, frames = len(offline.result.windows), len(offline.walk.time_s[::20])
    link = next(iter(offline.result.estimate_kg))
    assert recording.rows("/headline", "iteration") == 1 + updates
    assert recording.rows("/headline", "sim_time") == 0
    assert recording.rows(f"/world/robot/{link}", "sim_time") == frames
    assert recording.rows(f"/world/robot/{link}", "iteration") == 1
    mesh = f"/world/robot/{link}/mesh"
    on_walk = rgb_of(recording.column(mesh, "Mesh3D:albedo_factor", "sim_time"))
    on_passes = rgb_of(recording.column(mesh, "Mesh3D:albedo_factor", "iteration"))
    assert_allclose(on_walk, on_passes[-1:], atol=0)


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
