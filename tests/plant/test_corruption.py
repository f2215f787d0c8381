from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massid.assets import sample_walk
from massid.errors import BadInputError
from massid.log import read_walk, write_walk
from massid.plant import corrupt_log, truth_path
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS

FIELDS = ("stamps_ns", "qpos", "qvel", "effort", "wrench")


def _rows(walk: Walk, rows: slice | np.ndarray) -> Walk:  # type: ignore[type-arg]
    return replace(walk, segments=(), **{name: getattr(walk, name)[rows] for name in FIELDS})


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Half a second of walking, a gap, another half second, and a fall."""
    walk = read_walk(sample_walk())
    gap = replace(
        _rows(walk, np.r_[2000:2500, 3000:3500]),
        segments=(Segment(0, 500), Segment(500, 1000)),
        metadata=walk.metadata | {"end": "fell"},
    )
    path = write_walk(gap, tmp_path_factory.mktemp("clean") / "walk.mcap")
    truth_path(path).write_text(truth_path(sample_walk()).read_text())
    return path


def test_a_rewritten_walk_is_the_same(clean: Path, tmp_path: Path) -> None:
    first, again = (read_walk(path) for path in (clean, write_walk(read_walk(clean), tmp_path / "again.mcap")))
    for name in FIELDS:
        # The base velocity is turned into the base and back.
        np.testing.assert_allclose(getattr(first, name), getattr(again, name), rtol=0.0, atol=1e-15)
    assert first.segments == again.segments
    assert first.metadata == again.metadata


def test_the_noisy_log_keeps_model_gaps_and_end(clean: Path, tmp_path: Path) -> None:
    before, after = read_walk(clean), read_walk(corrupt_log(clean, tmp_path / "noisy.mcap", "realistic").path)
    assert after.segments == before.segments == (Segment(0, 500), Segment(500, 1000))
    assert [text.split(": ", 1)[1] for text in after.warnings] == [text.split(": ", 1)[1] for text in before.warnings]
    assert after.metadata == before.metadata | {"sensor_noise": "simulated"}
    np.testing.assert_array_equal(after.stamps_ns, before.stamps_ns)


def test_the_truth_file_explains_the_log_and_the_log_does_not_explain_itself(clean: Path, tmp_path: Path) -> None:
    written = corrupt_log(clean, tmp_path / "noisy.mcap", "realistic", seed=12)
    truth, before, after = json.loads(written.truth_path.read_text()), read_walk(clean), read_walk(written.path)
    assert truth["links"] == json.loads(truth_path(clean).read_text())["links"]
    sensors = truth["sensors"]
    assert (sensors["preset"], sensors["seed"]) == ("realistic", 12)
    drawn, std = sensors["drawn"], PRESETS["realistic"]
    effort = after.effort - np.array(drawn["effort_gain"]) * before.effort - drawn["effort_offset_nm"]
    assert effort.std() == pytest.approx(std.effort, rel=0.05)
    assert np.abs(effort.mean(axis=0)).max() < 5.0 * std.effort / np.sqrt(len(after))
    body = after.contact_bodies[0]
    force = (after.wrench - np.array(drawn["wrench_gain"][body]) * before.wrench)[:, 0, :3]
    np.testing.assert_allclose(force.mean(axis=0), drawn["wrench_offset"][body][:3], atol=5.0 * std.force / 30.0)
    assert not {"seed", "preset", "realistic"} & {*after.metadata, *after.metadata.values()}
    assert b"realistic" not in written.path.read_bytes()


def test_a_seed_stands_for_one_set_of_sensors(clean: Path, tmp_path: Path) -> None:
    logs = [
        corrupt_log(clean, tmp_path / f"{name}.mcap", "white", seed) for name, seed in (("a", 5), ("b", 5), ("c", 6))
    ]
    first, again, other = (read_walk(log.path) for log in logs)
    np.testing.assert_array_equal(first.qpos, again.qpos)
    np.testing.assert_array_equal(first.wrench, again.wrench)
    assert not np.any(first.effort == other.effort)
    assert (
        json.loads(logs[0].truth_path.read_text())["sensors"] == json.loads(logs[1].truth_path.read_text())["sensors"]
    )


def test_clean_sensors_copy_the_log(clean: Path, tmp_path: Path) -> None:
    copy = read_walk(corrupt_log(clean, tmp_path / "copy.mcap", "clean").path)
    np.testing.assert_array_equal(copy.effort, read_walk(clean).effort)
    assert copy.metadata == read_walk(clean).metadata


def test_what_cannot_be_corrupted_is_refused(clean: Path, tmp_path: Path) -> None:
    noisy = corrupt_log(clean, tmp_path / "noisy.mcap", "white").path
    with pytest.raises(BadInputError, match="has simulated sensor noise already"):
        corrupt_log(noisy, tmp_path / "twice.mcap", "white")
    with pytest.raises(BadInputError, match="is the clean log itself"):
        corrupt_log(clean, clean, "white")
    with pytest.raises(BadInputError, match=r"is the truth file of walk\.mcap itself"):
        corrupt_log(clean, clean.with_name("walk.log"), "white")
    with pytest.raises(BadInputError, match="no sensor noise named 'loud'"):
        corrupt_log(clean, tmp_path / "loud.mcap", "loud")  # type: ignore[arg-type]
    with pytest.raises(BadInputError, match="seed of the sensor noise is -1"):
        corrupt_log(clean, tmp_path / "seed.mcap", "white", seed=-1)
    spoilt = write_walk(read_walk(clean), tmp_path / "spoilt.mcap")
    truth_path(spoilt).write_text("no json")
    with pytest.raises(BadInputError, match="cannot be read as JSON"):
        corrupt_log(spoilt, tmp_path / "out.mcap", "white")
    assert not (tmp_path / "out.mcap").exists()
