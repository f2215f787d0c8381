"""Logs of other recorders: other encodings are read, and what does not fit is refused by name."""

from __future__ import annotations

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from rosbags.typesys import Stores, get_typestore

from massid.errors import LogError
from massid.log import load_topics, read_walk
from massid.log.summary import summarise_log
from massid.walk import Segment
from tests.log.samples import (
    JOINTS,
    START_NS,
    STEP_NS,
    TYPES,
    Foreign,
    as_ros1,
    assert_bridged,
    assert_same,
    make_samples,
    smooth_samples,
)

N = 40


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.ZSTD},
        {"compression": CompressionType.NONE},
        {"use_chunking": False},
        {"enable_crcs": False},
        {"use_summary_offsets": False, "repeat_channels": False, "repeat_schemas": False},
    ],
)
def test_other_encodings_give_the_same_walk(foreign, options, little_endian):
    walk = read_walk(foreign(N).write(little_endian=little_endian, **options))
    assert_same(walk, make_samples(N))
    unprotected = options.get("enable_crcs") is False or options.get("use_chunking") is False
    assert [line for line in walk.warnings if "carry no checksum" in line] == list(walk.warnings)
    assert bool(walk.warnings) == unprotected
    assert walk.metadata == {}
    assert walk.timestep_s == 1e-3


RENAMED = """
preset: massid
base: {topic: /state/base}
joints: {topic: /state/joints}
contacts: [{topic: /ft/*}]
"""


def test_topics_may_have_other_names(foreign, tmp_path):
    log = foreign(N)
    names = {
        "/odom": "/state/base",
        "/joint_states": "/state/joints",
        "/contact/l_foot": "/ft/left",
        "/contact/r_foot": "/ft/right",
    }
    log.messages = {names[topic]: messages for topic, messages in log.messages.items()}
    log.types = {names[topic]: name for topic, name in TYPES.items()}
    (tmp_path / "topics.yaml").write_text(RENAMED)
    walk = read_walk(log.write(), load_topics(tmp_path / "topics.yaml"))
    assert_same(walk, make_samples(N))
    assert walk.contact_bodies == ("l_foot", "r_foot")
    with pytest.raises(LogError, match=r"no base state: topic /odom is not in the log. Could supply it: /state/base"):
        read_walk(log.path)


def test_joints_are_matched_by_name_though_their_order_changes(foreign):
    log = foreign(N)
    for message in log.messages["/joint_states"][11:30:3]:
        order = [2, 0, 3, 1]
        message.name = [message.name[k] for k in order]
        for field in ("position", "velocity", "effort"):
            setattr(message, field, getattr(message, field)[order])
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N))
    assert walk.joint_names == JOINTS


def spoil_value(log):
    log.messages["/joint_states"][17].effort[2] = np.nan


def spoil_wrench(log):
    log.messages["/contact/r_foot"][5].wrench.torque.y = np.inf


def spoil_base(log):
    log.messages["/odom"][3].twist.twist.angular.z = -np.inf


def spoil_quaternion(log):
    q = log.messages["/odom"][9].pose.pose.orientation
    q.x = q.y = q.z = q.w = 0.0


def spoil_child_frame(log):
    log.messages["/odom"][9].child_frame_id = "torso"


def empty_child_frame(log):
    for message in log.messages["/odom"]:
        message.child_frame_id = ""


def no_effort(log):
    for message in log.messages["/joint_states"]:
        message.effort = np.zeros(0)


def no_effort_once(log):
    log.messages["/joint_states"][7].effort = np.zeros(0)


def short_velocity(log):
    for message in log.messages["/joint_states"]:
        message.velocity = message.velocity[:3]


def no_names(log):
    for message in log.messages["/joint_states"]:
        message.name = []


def same_name_twice(log):
    for message in log.messages["/joint_states"]:
        message.name = ["a", "b", "a", "c"]


def other_joints(log):
    log.messages["/joint_states"][8].name[1] = "l_elbow"


def two_topics_of_one_body(log):
    for message in log.messages["/contact/r_foot"]:
        message.header.frame_id = "l_foot"


def no_joint_states(log):
    del log.messages["/joint_states"]


def no_odometry_messages(log):
    log.messages["/odom"] = []


def no_contacts(log):
    del log.messages["/contact/l_foot"], log.messages["/contact/r_foot"]


def wrong_type(log):
    log.messages["/odom"] = log.messages["/joint_states"]
    log.types["/odom"] = TYPES["/joint_states"]


def other_era(log):
    for row in range(N):
        log.set_stamp("/odom", row, row * STEP_NS)


def no_stamps(log):
    for topic in TYPES:
        for row in range(N):
            log.set_stamp(topic, row, 0)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (spoil_child_frame, r"/odom: child_frame_id changes within the log \('pelvis', 'torso'\)"),
        (empty_child_frame, r"/odom: child_frame_id is empty, expected the name of the root body"),
        (no_effort, r"/joint_states: sample 0: effort has 0 values, expected one for each of the 4 joints"),
        (short_velocity, r"/joint_states: sample 0: velocity has 3 values, expected one for each of the 4"),
        (no_names, r"/joint_states: sample 0: no joint names"),
        (same_name_twice, r"/joint_states: joint 'a' occurs 2 times, expected once"),
        (two_topics_of_one_body, r"/contact/l_foot and /contact/r_foot both hold the wrench of body 'l_foot'"),
        (
            no_joint_states,
            r"no joint state: topic /joint_states is not in the log. A topic of sensor_msgs/msg/JointState "
            r"supplies it. The log has: /odom \(nav_msgs/msg/Odometry\), /contact/l_foot",
        ),
        (no_odometry_messages, r"no base state: topic /odom is there but holds no sample"),
        (no_contacts, r"no contact wrench: no topic like /contact/\* holds samples.*WrenchStamped supplies it"),
        (
            wrong_type,
            r"/odom \(sensor_msgs/msg/JointState\): sample 0: no field 'pose.pose.position'.*; the fields are",
        ),
        (other_era, r"no stretch of time is covered by all streams"),
        (no_stamps, r"/odom holds 1 usable samples, expected at least 2 \(39 samples repeat.*use `clock: log`"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(foreign, spoil, message):
    log = foreign(N)
    spoil(log)
    with pytest.raises(LogError, match=message) as caught:
        read_walk(log.write())
    assert str(caught.value).startswith(str(log.path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("spoil", "row", "message"),
    [
        (
            spoil_value,
            17,
            "/joint_states: sample 17: effort of joint 'r_hip' is nan, expected a finite number; 1 of 40",
        ),
        (spoil_wrench, 5, "/contact/r_foot: sample 5: wrench.torque.y is inf, expected a finite number; 1 of 40"),
        (spoil_base, 3, "/odom: sample 3: twist.twist.angular[2] is -inf, expected a finite number; 1 of 40"),
        (spoil_quaternion, 9, "/odom: sample 9: orientation has norm 0, expected 1 within 0.001; 1 of 40"),
        (no_effort_once, 7, "/joint_states: sample 7: effort has 0 values, expected one for each of the 4 joints; 1"),
        (other_joints, 8, "/joint_states: sample 8: the joints differ from those of most samples (missing: l_knee; "),
    ],
)
def test_samples_that_cannot_be_used_are_counted_and_bridged(foreign, spoil, row, message):
    log = foreign(N)
    spoil(log)
    walk = read_walk(log.write())
    assert_bridged(walk, make_samples(N), [row])
    assert any(line.startswith(f"{log.path}: {message}") for line in walk.warnings), walk.warnings


def test_a_topic_of_bad_values_only_is_refused(foreign):
    log = foreign(N)
    for message in log.messages["/joint_states"]:
        message.effort[2] = np.nan
    with pytest.raises(LogError, match=r"sample 0: effort of joint 'r_hip' is nan.*\(40 of 40 samples are like that\)"):
        read_walk(log.write())


def test_half_the_rate_is_resampled_and_said(foreign, tmp_path):
    log = foreign(N)
    log.drop("/odom", range(1, N, 2))
    (tmp_path / "map.yaml").write_text("preset: massid\nrate: slowest\n")
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    assert walk.timestep_s == 2e-3
    assert any("different rates (/odom 500 Hz, /joint_states 1000 Hz" in line for line in walk.warnings)
    rows = np.arange(0, len(walk) * 2, 2)
    samples = make_samples(N)
    # states at the slow topic's own stamps are not changed; inputs are the means over its period
    np.testing.assert_allclose(walk.qpos, samples.qpos[rows], rtol=0, atol=1e-12)
    np.testing.assert_allclose(walk.effort, 0.5 * (samples.effort[rows] + samples.effort[rows + 1]), atol=1e-9)


def test_a_slow_base_does_not_slow_the_joints_down(foreign):
    """50 Hz of a state estimator beside 1 kHz of the drives: nothing of the drives is thrown away."""
    samples = smooth_samples(200)
    log = Foreign(foreign(1).path, samples)
    log.drop("/odom", [row for row in range(200) if row % 20])
    walk = read_walk(log.write())
    assert walk.timestep_s == 1e-3
    n = len(walk)
    assert n >= 180
    np.testing.assert_array_equal(walk.qpos[:, 7:], samples.qpos[:n, 7:])
    np.testing.assert_allclose(walk.effort, samples.effort[:n], atol=1e-11)
    # a cubic over 20 ms of a motion of 10 rad/s: the fourth power of 0.2, over 384
    np.testing.assert_allclose(walk.qpos[:, :3], samples.qpos[:n, :3], atol=1e-5)


def test_stamps_of_another_clock_are_resampled(foreign):
    log = foreign(N)
    for row in range(N):
        log.set_stamp("/odom", row, START_NS + row * STEP_NS + 1)
    walk = read_walk(log.write())
    assert any("only 0 stamps are shared by all streams (samples: /odom 40" in line for line in walk.warnings)
    # one nanosecond of a millisecond: a millionth of the change from one sample to the next
    np.testing.assert_allclose(walk.effort, make_samples(N).effort[: len(walk)], atol=1e-3)


@pytest.mark.parametrize("definition", [b"", b"not a definition at all", None])
@pytest.mark.parametrize("encoding", ["", "ros2idl", "ros2msg"])
def test_standard_messages_need_no_definition(foreign, encoding, definition):
    log = foreign(N)
    if definition is not None:
        log.definitions = dict.fromkeys(TYPES.values(), definition)
    walk = read_walk(log.write(schema_encoding=encoding))
    assert_same(walk, make_samples(N))
    if encoding != "ros2msg" or definition is not None:
        assert any("nav_msgs/msg/Odometry that can be read; the standard one was taken" in w for w in walk.warnings)


def test_a_definition_may_name_times_as_ros_1_does_and_leave_out_standard_messages(foreign):
    log = foreign(N)
    log.definitions = {name: log.store.generate_msgdef(name, ros_version=1)[0].encode() for name in set(TYPES.values())}
    assert b"time stamp" in log.definitions["nav_msgs/msg/Odometry"]
    log.definitions["geometry_msgs/msg/WrenchStamped"] = b"std_msgs/Header header\ngeometry_msgs/Wrench wrench\n"
    walk = read_walk(log.write())
    assert_same(walk, make_samples(N))
    assert walk.warnings == ()


def test_a_message_of_ones_own_without_a_definition_is_refused(foreign):
    log = foreign(N)
    log.names = {"/odom": "my_msgs/msg/State"}
    with pytest.raises(
        LogError, match=r"/odom: has no definition of my_msgs/msg/State, and massid knows none.*ros2msg"
    ):
        read_walk(log.write(schema_encoding=""))


def test_messages_compressed_one_by_one_are_read(foreign):
    log = foreign(N)
    log.encode = lambda data: zstandard.ZstdCompressor().compress(data)
    assert_same(read_walk(log.write()), make_samples(N))


def test_a_small_message_that_inflates_beyond_any_message_is_not_inflated(foreign):
    bomb = zstandard.ZstdCompressor().compress(bytes(1 << 26))
    log = foreign(N)
    log.encode = lambda _: bomb
    with pytest.raises(LogError, match=r"a compressed message of 67108864 bytes, more than \d+"):
        read_walk(log.write())


def test_a_small_chunk_that_inflates_beyond_what_it_says_is_damage(foreign, tmp_path):
    path = foreign(N).write(compression=CompressionType.LZ4, chunk_size=1 << 20)
    data = path.read_bytes()
    bomb = lz4.frame.compress(bytes(1 << 27))
    with path.open("rb") as stream:
        chunk = next(r for r in StreamReader(stream, emit_chunks=True).records if isinstance(r, Chunk))
    at = data.index(chunk.data)
    (tmp_path / "bomb.mcap").write_bytes(
        data[: at - 8] + len(bomb).to_bytes(8, "little") + bomb + data[at + len(chunk.data) :]
    )
    with pytest.raises(LogError, match="no base state"):
        read_walk(tmp_path / "bomb.mcap")


def test_another_encapsulation_is_named(foreign):
    log = foreign(N)
    log.encode = lambda data: b"\0\x07" + data[2:]
    with pytest.raises(LogError, match=r"header 00 07 00 00 is not plain CDR \(00 00 or 00 01\) but XCDR2"):
        read_walk(log.write())


def test_ros_1_messages_in_an_mcap_file_are_read(foreign):
    log = foreign(N)
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    log.definitions = {name: ros1.generate_msgdef(name, ros_version=1)[0].encode() for name in set(TYPES.values())}
    log.serialize = as_ros1
    walk = read_walk(log.write(message_encoding="ros1", schema_encoding="ros1msg"))
    assert_same(walk, make_samples(N))


def test_cdr_that_calls_itself_ros_1_is_told_from_it(foreign):
    with pytest.raises(LogError, match=r"the log says 'ros1': if it was converted, .*`rosbags-convert`"):
        read_walk(foreign(N).write(message_encoding="ros1", schema_encoding="ros1msg"))


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
