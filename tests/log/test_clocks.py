"""Stamps and times: what belongs together is paired, whatever stamps say, and what was done is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from massid.log import load_topics, read_walk
from massid.walk import Segment
from tests.log.samples import (
    FEET,
    START_NS,
    STEP_NS,
    TYPES,
    Foreign,
    assert_same,
    make_samples,
    smooth_samples,
)

N = 200
HALF = N // 2


def by_row(log: Foreign) -> list[tuple[str, int]]:
    """Messages as a recorder writes them: all topics of one sample, then of the next."""
    return [(topic, row) for row in range(N) for topic in TYPES]


def test_messages_out_of_order_are_sorted_and_none_is_lost(foreign) -> None:
    rng = np.random.default_rng(1)
    log = foreign(N)
    order = by_row(log)
    for place in rng.choice(len(order) - 20, 40, replace=False):
        order.insert(int(place) + int(rng.integers(4, 13)), order.pop(int(place)))
    walk = read_walk(log.write(order=order))
    assert_same(walk, make_samples(N))
    assert walk.segments == (Segment(0, N),)
    assert any("messages came out of order; sorted by their stamps" in line for line in walk.warnings)


@pytest.mark.parametrize("late_is_logged", [True, False])
def test_late_messages_are_sorted_with_and_without_honest_log_times(foreign, late_is_logged) -> None:
    log = foreign(N)
    order = [row for row in range(N)]
    order.insert(53, order.pop(50))
    log.messages["/odom"] = [log.messages["/odom"][row] for row in order]
    log_times = {row: START_NS + row * STEP_NS for row in range(N)} if late_is_logged else None
    assert_same(read_walk(log.write(log_times=log_times)), make_samples(N))


@pytest.mark.parametrize("lost", [{}, {"/joint_states": [30], "/odom": [HALF + 60]}])
@pytest.mark.parametrize("pause_s", [0.0, 3.0])
def test_a_clock_that_restarts_pairs_no_samples_of_two_runs(foreign, lost, pause_s) -> None:
    """A simulation that is reset: stamps begin again, recording goes on. Every pair stays one."""
    samples = make_samples(N)
    log = foreign(N)
    for topic in TYPES:
        for row in range(N):
            log.set_stamp(topic, row, 10**9 + (row % HALF) * STEP_NS)
    rows = {topic: [row for row in range(N) if row not in lost.get(topic, [])] for topic in TYPES}
    order = [(topic, row) for row in range(N) for topic in TYPES if row in rows[topic]]
    pause_ns = int(pause_s * 1e9)
    times = {row: START_NS + row * STEP_NS + (pause_ns if row >= HALF else 0) for row in range(N)}
    walk = read_walk(log.write(order=order, log_times=times))
    assert walk.segments == (Segment(0, HALF), Segment(HALF, N))
    gone = sorted({row for missing in lost.values() for row in missing})
    kept = np.delete(np.arange(N), gone)  # those lost are bridged within their run
    np.testing.assert_array_equal(walk.qpos[kept], samples.qpos[kept])
    np.testing.assert_array_equal(walk.effort[kept], samples.effort[kept])
    np.testing.assert_array_equal(walk.wrench[kept, 0], samples.wrenches["l_foot"][kept])
    assert (np.diff(walk.stamps_ns) > 0).all()
    assert any("clock of the stamps restarts 1 time, on /odom by" in line for line in walk.warnings)


def test_a_part_that_stands_in_the_file_twice_counts_once(foreign) -> None:
    """As after merging recordings that overlap: the same messages, recorded at the same times."""
    log = foreign(N)
    for topic in TYPES:
        log.messages[topic] += log.messages[topic][20:120]
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N))
    assert any("/odom: 100 messages stand in the log twice" in line for line in walk.warnings)


def test_times_of_recording_that_restart_as_well_order_nothing(foreign) -> None:
    """As in a simulation whose recorder takes its time, or in a table of several episodes."""
    rng = np.random.default_rng(3)
    log = foreign(N)
    for topic in TYPES:
        for row in range(N):
            log.set_stamp(topic, row, 10**9 + (row % HALF) * STEP_NS + int(rng.integers(0, 1000)) * (topic == "/odom"))
    for row in range(N):
        for topic in TYPES:
            time = log.messages["/odom"][row].header.stamp
            log.set_stamp(topic, row, time.sec * 10**9 + time.nanosec)
    walk = read_walk(log.write(order=by_row(log)))
    assert walk.segments == (Segment(0, HALF), Segment(HALF, N))
    np.testing.assert_array_equal(walk.effort, make_samples(N).effort)


def test_a_topic_that_is_silent_while_the_clock_restarts_is_cut_with_the_others(foreign) -> None:
    log = foreign(N)
    for topic in TYPES:
        for row in range(N):
            log.set_stamp(topic, row, 10**9 + (row % HALF) * STEP_NS)
    order = [(topic, row) for row in range(N) for topic in TYPES if topic != "/contact/l_foot" or row >= HALF]
    walk = read_walk(log.write(order=order, log_times={row: START_NS + row * STEP_NS for row in range(N)}))
    assert_same_rows(walk, np.arange(HALF, N))


def assert_same_rows(walk, rows) -> None:
    samples = make_samples(N)
    np.testing.assert_array_equal(walk.qpos, samples.qpos[rows])
    np.testing.assert_array_equal(walk.effort, samples.effort[rows])
    for column, body in enumerate(walk.contact_bodies):
        np.testing.assert_array_equal(walk.wrench[:, column], samples.wrenches[body][rows])


@pytest.mark.parametrize("offset_s", [-1.7e9, -3.0, 3.0])
def test_a_clock_that_is_off_by_a_constant_is_found_and_said(foreign, tmp_path: Path, offset_s) -> None:
    """Force sensors that stamp with the time since they were switched on, or on a computer whose clock is wrong."""
    log = foreign(N)
    for foot in FEET:
        for row in range(N):
            log.set_stamp(f"/contact/{foot}", row, START_NS + int(offset_s * 1e9) + row * STEP_NS)
    times = {row: START_NS + row * STEP_NS for row in range(N)}
    walk = read_walk(log.write(log_times=times))
    assert_same(walk, make_samples(N))
    side = "before" if offset_s < 0 else "after"
    said = [line for line in walk.warnings if "another clock" in line]
    assert len(said) == 1
    assert f"/contact/l_foot, /contact/r_foot are {abs(offset_s):.6g} s {side} those of the others" in said[0]
    (tmp_path / "map.yaml").write_text("preset: massid\nclock: log\n")
    assert "`clock: log`" in said[0]
    assert_same(read_walk(log.path, load_topics(tmp_path / "map.yaml")), make_samples(N))


def test_stamps_that_are_off_by_little_are_said_and_left(foreign) -> None:
    """A force sensor whose messages are under way for long, or a computer whose clock is off: nothing tells which."""
    log = foreign(N)
    for foot in FEET:
        for row in range(N):
            log.set_stamp(f"/contact/{foot}", row, START_NS + (row - 40) * STEP_NS)
    walk = read_walk(log.write(log_times={row: START_NS + row * STEP_NS for row in range(N)}))
    assert len(walk) == N - 40
    said = [line for line in walk.warnings if "are 0.04 s before those of the others" in line]
    assert len(said) == len(FEET)
    assert all("`clock: log`" in line for line in said)


def test_recording_late_is_no_other_clock(foreign) -> None:
    """Messages that were under way for up to a tenth of a second are not shifted."""
    rng = np.random.default_rng(2)
    log = foreign(N)
    times = {row: START_NS + row * STEP_NS + int(1e8 * rng.random()) for row in range(N)}
    walk = read_walk(log.write(log_times=times))
    assert_same(walk, make_samples(N))
    assert walk.warnings == ()


@pytest.mark.parametrize("lost", [(), (40, 90, 91)])
def test_stamps_taken_when_each_message_was_sent_belong_to_one_cycle(foreign, lost) -> None:
    rng = np.random.default_rng(5)
    log = Foreign(foreign(1).path, smooth_samples(N))
    for topic in TYPES:
        for row in range(N):
            log.set_stamp(topic, row, START_NS + row * STEP_NS + int(rng.integers(0, 200_000)))
    log.drop("/joint_states", lost)
    walk = read_walk(log.write())
    samples = smooth_samples(N)
    kept = np.delete(np.arange(N), lost)
    np.testing.assert_array_equal(walk.qpos[kept], samples.qpos[kept])
    np.testing.assert_array_equal(walk.effort[kept], samples.effort[kept])
    assert walk.timestep_s == 1e-3
    assert (np.diff(walk.stamps_ns) == STEP_NS).all()
    assert any("messages were stamped when they were sent" in line for line in walk.warnings)


def test_even_clocks_apart_are_no_cycle(foreign) -> None:
    """Torques sampled half a step after the states stay there: they are averaged, not taken for those of the state."""
    log = Foreign(foreign(1).path, smooth_samples(N))
    for row in range(N):
        log.set_stamp("/joint_states", row, START_NS + row * STEP_NS + STEP_NS // 2)
    walk = read_walk(log.write())
    assert any("resampled to the clock of /odom" in line for line in walk.warnings)


def test_stamps_that_are_never_set_name_the_setting(foreign) -> None:
    log = foreign(N)
    for topic in TYPES:
        for row in range(150):
            log.set_stamp(topic, row, 0)
    walk = read_walk(log.write())
    assert any("150" in line or "149 samples repeat" in line for line in walk.warnings)
    assert any("`clock: log` in a topic map" in line for line in walk.warnings)


def zero_when_off_the_ground(log: Foreign, foot: str, swings: list[tuple[int, int]]) -> np.ndarray:
    """Let the force of a foot fade before each swing; returns the wrench with zeros while it swings."""
    wrench = smooth_samples(N).wrenches[foot].copy()
    for start, stop in swings:
        wrench[start - 10 : start] *= np.linspace(1.0, 0.01, 10)[:, None]
        wrench[start:stop] = 0.0
    for row, message in enumerate(log.messages[f"/contact/{foot}"]):
        for part, values in ((message.wrench.force, wrench[row, :3]), (message.wrench.torque, wrench[row, 3:])):
            part.x, part.y, part.z = map(float, values)
    return wrench


@pytest.mark.parametrize("setting", ["auto", "zero"])
def test_a_contact_topic_that_is_silent_in_swing_is_no_force(foreign, tmp_path: Path, setting) -> None:
    log = Foreign(foreign(1).path, smooth_samples(N))
    swings = [(20, 50), (100, 140), (180, N)]
    wrench = zero_when_off_the_ground(log, "l_foot", swings)
    log.drop("/contact/l_foot", [row for start, stop in swings for row in range(start, stop)])
    (tmp_path / "map.yaml").write_text(f"preset: massid\ncontacts: [{{topic: /contact/*, silence: {setting}}}]\n")
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    assert walk.segments == (Segment(0, N),)
    np.testing.assert_array_equal(walk.wrench[:, walk.contact_bodies.index("l_foot")], wrench)
    assert any("/contact/l_foot: silent in 3 stretches of up to 0.04 s" in line for line in walk.warnings)


def test_a_silence_under_load_is_a_loss(foreign, tmp_path: Path) -> None:
    log = Foreign(foreign(1).path, smooth_samples(N))
    log.drop("/contact/l_foot", range(100, 140))
    walk = read_walk(log.write())
    assert walk.segments == (Segment(0, 100), Segment(100, 160))
    assert not any("silent" in line for line in walk.warnings)


def test_silence_can_be_called_a_loss(foreign, tmp_path: Path) -> None:
    log = Foreign(foreign(1).path, smooth_samples(N))
    zero_when_off_the_ground(log, "l_foot", [(100, 140)])
    log.drop("/contact/l_foot", range(100, 140))
    (tmp_path / "map.yaml").write_text("preset: massid\ncontacts: [{topic: /contact/*, silence: lost}]\n")
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    assert len(walk.segments) == 2
