"""A repaired file holds what was sound, opens without a warning, and the loss is counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader

from massid.errors import BadInputError, LogError
from massid.log import read_walk, repair_log, summarise_log
from tests.log.samples import Samples, assert_same, make_samples, write_samples


@pytest.fixture
def long(tmp_path: Path) -> tuple[Path, Samples]:
    samples = make_samples(1000)
    return write_samples(tmp_path / "walk.mcap", samples), samples


def test_a_cut_file_becomes_whole(long: tuple[Path, Samples], tmp_path: Path) -> None:
    path, samples = long
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    damaged = read_walk(cut)
    repaired = repair_log(cut, tmp_path / "clean.mcap")
    walk = read_walk(repaired.path)
    assert 0 < len(walk) < len(samples)
    assert len(walk) == len(damaged)
    assert walk.warnings == ()
    assert any("not closed or cut off" in line for line in repaired.losses)
    assert repaired.messages["/odom"] == len(walk)
    assert_same(walk, samples, slice(0, len(walk)))
    with repaired.path.open("rb") as stream:  # the reader of mcap's own library takes it as well
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == sum(repaired.messages.values())


def test_a_flipped_byte_costs_its_chunk(long: tuple[Path, Samples], tmp_path: Path) -> None:
    path, samples = long
    spoiled = bytearray(path.read_bytes())
    spoiled[len(spoiled) // 2] ^= 1
    (tmp_path / "spoiled.mcap").write_bytes(spoiled)
    repaired = repair_log(tmp_path / "spoiled.mcap", tmp_path / "clean.mcap")
    assert any("samples lost" in line for line in repaired.losses)
    walk = read_walk(repaired.path)
    rows = np.searchsorted(samples.stamps, walk.stamps_ns)
    assert_same(walk, samples, rows)
    assert len(walk.segments) == 2
    assert "1 gap longer" in walk.warnings[0]
    assert len(walk.warnings) == 1


def test_a_sound_file_is_copied_without_loss(long: tuple[Path, Samples], tmp_path: Path) -> None:
    path, samples = long
    repaired = repair_log(path, tmp_path / "clean.mcap")
    assert repaired.losses == ()
    assert_same(read_walk(repaired.path), samples)
    assert read_walk(repaired.path).metadata == read_walk(path).metadata


def test_a_file_is_not_repaired_onto_itself_nor_from_nothing(long: tuple[Path, Samples], tmp_path: Path) -> None:
    path, _ = long
    with pytest.raises(BadInputError, match="is the damaged file itself"):
        repair_log(path, path)
    (tmp_path / "empty.mcap").write_bytes(b"\x89MCAP0\r\n")
    with pytest.raises(LogError, match="holds no message that can be read"):
        repair_log(tmp_path / "empty.mcap", tmp_path / "clean.mcap")
    assert not (tmp_path / "clean.mcap").exists()
    assert read_walk(path).warnings == ()


def test_what_a_killed_recorder_left_is_repaired_under_its_final_name(
    long: tuple[Path, Samples], tmp_path: Path
) -> None:
    path, samples = long
    partial = path.rename(tmp_path / "walk.mcap.partial")
    repair_log(partial, tmp_path / "walk.mcap")
    assert_same(read_walk(tmp_path / "walk.mcap"), samples)
    assert read_walk(partial).warnings == ()


def test_the_summary_counts_messages_rates_and_gaps(foreign, tmp_path: Path) -> None:
    log = foreign(40)
    log.drop("/odom", range(10, 15))
    summary = summarise_log(log.write())
    topics = {topic.info.topic: topic for topic in summary.topics}
    assert topics["/odom"].messages == 35
    assert topics["/odom"].gaps == 1
    assert topics["/odom"].longest_gap_s == pytest.approx(6e-3)
    assert topics["/joint_states"].gaps == 0
    assert topics["/joint_states"].rate_hz == pytest.approx(1000.0)
    assert summary.duration_s == pytest.approx(39e-3)
