"""What a log lost: samples, stamps and values are bridged, cut or left out, counted and said."""

from __future__ import annotations

import numpy as np
import pytest

from massid.errors import LogError
from massid.log import load_topics, read_walk
from massid.log.summary import summarise_log
from massid.walk import Segment
from tests.log.samples import (
    START_NS,
    STEP_NS,
    TYPES,
    Foreign,
    assert_bridged,
    assert_same,
    make_samples,
    smooth_samples,
)

N = 40


def test_a_quaternion_that_is_slightly_off_is_normalised_and_said(foreign):
    log = foreign(N)
    q = log.messages["/odom"][9].pose.pose.orientation
    q.x, q.y, q.z, q.w = (1.0005 * value for value in (q.x, q.y, q.z, q.w))
    walk = read_walk(log.write())
    assert walk.warnings == (f"{log.path}: /odom: 1 quaternions are off unit norm by up to 0.0005; normalised.",)
    # normalising undoes the scaling up to rounding
    np.testing.assert_allclose(walk.qpos[9], make_samples(N).qpos[9], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(np.delete(walk.qpos, 9, 0), np.delete(make_samples(N).qpos, 9, 0))


def test_samples_missing_on_one_topic_are_left_out_and_counted(foreign):
    log = foreign(N)
    log.drop("/contact/l_foot", [20, 21])
    walk = read_walk(log.write())
    assert_bridged(walk, make_samples(N), [20, 21])
    assert walk.warnings == (
        f"{log.path}: /contact/l_foot: 2 of 40 samples are missing, no more than 3 in a row; bridged by interpolation.",
    )
    # a force in between is on the line between its neighbours; what the other topics hold stays as it is
    left = make_samples(N).wrenches["l_foot"]
    np.testing.assert_allclose(walk.wrench[20, 0], (2 * left[19] + left[22]) / 3, rtol=1e-12)
    np.testing.assert_array_equal(walk.effort[20:22], make_samples(N).effort[20:22])


def test_more_than_a_few_samples_in_a_row_are_a_gap(foreign):
    log = foreign(N)
    log.drop("/contact/l_foot", range(20, 24))
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N), np.delete(np.arange(N), range(20, 24)))
    assert walk.segments == (Segment(0, 20), Segment(20, 36))
    assert walk.warnings == (
        f"{log.path}: /contact/l_foot: no sample for 4 of 40 stamps, the first 0.0200 s after the start; "
        "these stamps are left out.",
        f"{log.path}: 1 gap longer than 1.5 sample periods, the first of 0.0050 s after sample 19.",
    )


def test_what_is_bridged_follows_a_smooth_motion(foreign):
    """Lost one by one on every topic, the samples of a smooth walk come back to the order of interpolation."""
    log, samples = Foreign(foreign(N).path, smooth_samples(400)), smooth_samples(400)
    lost = {topic: range(11 + 3 * k, 400 - 11, 37) for k, topic in enumerate(TYPES)}
    for topic, rows in lost.items():
        log.drop(topic, rows)
    walk = read_walk(log.write())
    assert walk.segments == (Segment(0, 400),)
    np.testing.assert_array_equal(walk.stamps_ns, samples.stamps)
    for found, true in ((walk.qpos, samples.qpos), (walk.qvel, samples.qvel), (walk.effort, samples.effort)):
        assert np.abs(found - true).max() < 1e-4 * np.abs(true).max()  # half the square of 1 ms times 10 rad/s
    assert sum("bridged by interpolation" in line for line in walk.warnings) == len(TYPES)


def test_a_gap_makes_segments(foreign):
    log = foreign(N)
    for topic in TYPES:
        log.drop(topic, range(10, 20))
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N), np.delete(np.arange(N), slice(10, 20)))
    assert walk.segments == (Segment(0, 10), Segment(10, 30))
    assert walk.duration_s == pytest.approx(30e-3)


def test_repeated_samples_are_left_out_and_counted(foreign):
    log = foreign(N)
    for topic in TYPES:
        log.messages[topic].insert(13, log.messages[topic][12])
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N))
    assert walk.segments == (Segment(0, N),)
    assert f"{log.path}: /odom: 1 messages stand in the log twice; each was taken once." in walk.warnings


def test_stamps_that_repeat_are_left_out_and_counted(foreign):
    """A publisher that sends on after its clock has stopped."""
    log = foreign(N)
    for topic in TYPES:
        log.set_stamp(topic, 13, START_NS + 12 * STEP_NS)
    walk = read_walk(log.write(log_times={row: START_NS + row * STEP_NS for row in range(N)}))
    assert_bridged(walk, make_samples(N), [13])
    assert f"{log.path}: /odom: 1 samples repeat the stamp before them, first sample 13; left out." in walk.warnings


def test_one_wild_stamp_costs_one_sample(foreign):
    for wild in (START_NS + 10**12, START_NS - 10**12):
        log = foreign(N)
        for topic in TYPES:
            log.set_stamp(topic, 13, wild)
        walk = read_walk(log.write())
        assert_bridged(walk, make_samples(N), [13])
        assert any("/odom: stamps jump back 1 times" in line for line in walk.warnings)


NEVER_NS = (1 << 64) - 1


def test_a_log_time_that_is_no_time_costs_its_samples_only_where_log_times_count(foreign, tmp_path):
    (tmp_path / "map.yaml").write_text("preset: massid\nclock: log\n")
    by_log = load_topics(tmp_path / "map.yaml")
    some, all_rows = {13: NEVER_NS}, dict.fromkeys(range(N), 1 << 63)
    log = foreign(N)
    for log_times in (some, all_rows):
        assert_same(read_walk(log.write(log_times=log_times)), make_samples(N))
    walk = read_walk(log.write(log_times=some), by_log)
    assert_bridged(walk, make_samples(N), [13])
    assert any("log times of 2^63 ns or more" in w and "1 of 40" in w for w in walk.warnings)
    assert any("/odom: 1 of 40 log times are 2^63 ns or more" in w for w in summarise_log(log.path).warnings)
    with pytest.raises(LogError, match=r"/odom: log times of 2\^63 ns or more, .* \(40 of 40 samples are like that\)"):
        read_walk(log.write(log_times=all_rows), by_log)


def test_a_clock_set_back_cuts_the_walk(foreign):
    log = foreign(N)
    for topic in TYPES:
        for row in range(20, N):
            log.set_stamp(topic, row, START_NS + (row - 5) * STEP_NS)
    walk = read_walk(log.write())
    assert len(walk) == N - 5
    assert (np.diff(walk.stamps_ns) == STEP_NS).all()
    assert len(walk.segments) == 2
    assert any("stamps jump back 1 times, first by 0.0040 s at sample 20; 5 samples" in w for w in walk.warnings)
    # within a segment the samples are neighbours in the file, too
    original = make_samples(N)
    for segment in walk.segments:
        rows = [
            int(np.flatnonzero((original.qpos == q).all(axis=1))[0]) for q in walk.qpos[segment.start : segment.stop]
        ]
        assert (np.diff(rows) == 1).all()


def test_a_contact_topic_without_samples_is_said(foreign):
    log = foreign(N)
    log.messages["/contact/r_foot"] = []
    walk = read_walk(log.write())
    assert walk.contact_bodies == ("l_foot",)
    assert walk.warnings == (f"{log.path}: /contact/r_foot: holds no sample; taken as no contact topic.",)
