"""What goes into a log comes out of it, bit for bit, and any ROS 2 tool reads the same."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from massid.errors import LogError
from massid.log import WalkWriter, read_walk
from massid.walk import Segment
from tests.log.samples import (
    FEET,
    JOINTS,
    ROOT,
    ROTATION_ROUNDING_M_S,
    START_NS,
    STEP_NS,
    assert_same,
    make_samples,
    rotation,
    write_samples,
)


def test_round_trip_is_exact(log, samples):
    walk = read_walk(log)
    assert_same(walk, samples)
    assert (walk.root_body, walk.joint_names, walk.contact_bodies) == (ROOT, JOINTS, FEET)
    assert walk.timestep_s == 1e-3
    assert walk.segments == (Segment(0, len(samples)),)
    assert walk.warnings == ()
    assert walk.metadata["end"] == "complete"
    assert not log.with_name("walk.mcap.partial").exists()


@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_any_small_log_round_trips(data, tmp_path_factory):
    n = data.draw(st.integers(2, 12), "samples")
    n_joints = data.draw(st.integers(1, 5), "joints")
    number = st.floats(-1e99, 1e99)
    samples = make_samples(n, n_joints, seed=data.draw(st.integers(0, 99), "seed"))
    samples.qpos[:, 7:] = data.draw(arrays(np.float64, (n, n_joints), elements=number), "joint positions")
    samples.effort[:] = data.draw(arrays(np.float64, (n, n_joints), elements=number), "effort")
    samples.wrenches["l_foot"][:] = data.draw(arrays(np.float64, (n, 6), elements=number), "wrench")
    samples.wrenches["l_foot"][0, 0] = 1.0  # it touches, so it has a topic
    samples.stamps[:] = data.draw(st.integers(0, 2**60), "start") + samples.stamps - START_NS
    names = [f"gelenk ä{k}" * k or "j" for k in range(n_joints)]
    path = tmp_path_factory.mktemp("log") / "walk.mcap"
    block = data.draw(st.integers(1, n), "block")
    walk = read_walk(write_samples(path, samples, block, joint_names=names))
    assert_same(walk, samples)
    assert walk.joint_names == tuple(names)


def test_single_samples_and_blocks_write_the_same_bytes(tmp_path, log, samples):
    path = tmp_path / "single" / log.name
    path.parent.mkdir()
    with WalkWriter(path, root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
        for k in range(len(samples)):
            wrenches = {body: wrench[k] for body, wrench in samples.wrenches.items()}
            stamp = int(samples.stamps[k])
            writer.append(stamp, samples.qpos[k], samples.qvel[k], samples.effort[k], wrenches)
    assert path.read_bytes() == log.read_bytes()


def test_arrays_of_a_read_walk_are_read_only(log):
    walk = read_walk(log)
    for array in (walk.stamps_ns, walk.qpos, walk.qvel, walk.effort, walk.wrench):
        assert not array.flags.writeable


@pytest.mark.parametrize("first", [0, 10, 350, 999])
def test_a_body_that_touches_later_is_back_filled_with_zeros(tmp_path, samples, first):
    samples.wrenches["r_foot"][:first] = 0.0
    path = tmp_path / "late.mcap"
    with WalkWriter(path, root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
        for k in range(0, len(samples), 50):
            stamps, qpos, qvel, effort, wrenches = samples.block(k, k + 50)
            if not wrenches["r_foot"].any():
                del wrenches["r_foot"]
            writer.append_block(stamps, qpos, qvel, effort, wrenches)
    walk = read_walk(path)
    assert_same(walk, samples)
    assert walk.contact_bodies == FEET
    with path.open("rb") as stream:
        counts = make_reader(stream).get_summary().statistics.channel_message_counts
    assert set(counts.values()) == {len(samples)}


def test_a_body_left_out_of_a_block_has_no_contact(tmp_path, samples):
    path = tmp_path / "walk.mcap"
    with WalkWriter(path, root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
        writer.append_block(*samples.block(0, 500))
        writer.append_block(*samples.block(500, 1000)[:4], {"l_foot": samples.wrenches["l_foot"][500:]})
    walk = read_walk(path)
    assert_array_equal(walk.wrench[500:, 1], 0.0)
    assert_array_equal(walk.wrench[:500, 1], samples.wrenches["r_foot"][:500])


def test_bodies_named_at_the_start_have_a_topic_though_they_never_touch(tmp_path, samples):
    path = tmp_path / "walk.mcap"
    options = {"root_body": ROOT, "joint_names": JOINTS, "timestep_s": 1e-3}
    with WalkWriter(path, contact_bodies=("r hand", "r_hand", "7th"), **options) as writer:
        writer.append_block(*samples.block(0, 10)[:4], {})
    walk = read_walk(path)
    assert walk.contact_bodies == ("r hand", "r_hand", "7th")
    assert_array_equal(walk.wrench, 0.0)


def test_metadata_comes_back(tmp_path, samples):
    metadata = {"model": "atlas.xml", "sha256": "00ff", "noise": "Grüße: {1, 2}"}
    walk = read_walk(write_samples(tmp_path / "walk.mcap", samples, metadata=metadata))
    assert walk.metadata == {**metadata, "root_body": ROOT, "timestep_s": "0.001", "end": "complete"}


@pytest.mark.parametrize("rate_hz", [300, 500, 1000, 4096])
def test_the_timestep_is_that_of_the_stamps(tmp_path, samples, rate_hz):
    samples.stamps[:] = START_NS + np.arange(len(samples)) * 10**9 // rate_hz
    walk = read_walk(write_samples(tmp_path / "walk.mcap", samples, timestep_s=1 / rate_hz))
    assert walk.warnings == ()
    assert walk.timestep_s == pytest.approx(1 / rate_hz, rel=0, abs=1e-9)  # stamps are whole nanoseconds
    assert len(walk.segments) == 1


def test_a_recorder_that_states_another_timestep_is_doubted(tmp_path, samples):
    path = write_samples(tmp_path / "walk.mcap", samples, timestep_s=2e-3)
    walk = read_walk(path)
    assert walk.timestep_s == 1e-3
    assert walk.warnings == (f"{path}: the recorder states a timestep of 0.002 s, the stamps give 0.001 s.",)


def test_another_ros_library_decodes_equal_values(log, samples):
    topics: dict[str, list] = {}
    with AnyReader([log]) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            header = message.header.stamp
            assert stamp == header.sec * 10**9 + header.nanosec
            topics.setdefault(connection.topic, []).append((stamp, message))
    assert sorted(topics) == ["/contact/l_foot", "/contact/r_foot", "/joint_states", "/odom"]
    for messages in topics.values():
        assert_array_equal([stamp for stamp, _ in messages], samples.stamps)
    for k, (_, message) in enumerate(topics["/joint_states"]):
        assert tuple(message.name) == JOINTS
        assert_array_equal(message.position, samples.qpos[k, 7:])
        assert_array_equal(message.velocity, samples.qvel[k, 6:])
        assert_array_equal(message.effort, samples.effort[k])
    for k, (_, message) in enumerate(topics["/odom"]):
        assert (message.header.frame_id, message.child_frame_id) == ("world", ROOT)
        p, q = message.pose.pose.position, message.pose.pose.orientation
        assert_array_equal([p.x, p.y, p.z, q.w, q.x, q.y, q.z], samples.qpos[k, :7])
        w, v = message.twist.twist.angular, message.twist.twist.linear
        assert_array_equal([w.x, w.y, w.z], samples.qvel[k, 3:6])
        world = rotation(samples.qpos[k, 3:7]) @ np.array([v.x, v.y, v.z])
        assert_allclose(world, samples.qvel[k, :3], rtol=0, atol=ROTATION_ROUNDING_M_S)
        assert not message.pose.covariance.any()
    for body in FEET:
        for k, (_, message) in enumerate(topics[f"/contact/{body}"]):
            assert message.header.frame_id == body
            f, t = message.wrench.force, message.wrench.torque
            assert_array_equal([f.x, f.y, f.z, t.x, t.y, t.z], samples.wrenches[body][k])


def test_type_hashes_and_definitions_are_those_of_ros(log):
    with AnyReader([log]) as reader:
        for connection in reader.connections:
            assert (
                reader.typestore.hash_rihs01(connection.msgtype) == _channel(log, connection.topic)["topic_type_hash"]
            )
            qos = connection.ext.offered_qos_profiles
            assert [profile.reliability.name for profile in qos] == ["RELIABLE"]


def _channel(path: Path, topic: str) -> dict[str, str]:
    with path.open("rb") as stream:
        channels = make_reader(stream).get_summary().channels.values()
        return next(channel.metadata for channel in channels if channel.topic == topic)


def test_mcap_validates_the_file_and_its_chunks(log, samples):
    with log.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary.statistics.message_count == 4 * len(samples)
        assert sum(1 for _ in reader.iter_messages()) == 4 * len(samples)
        names = [record.name for record in reader.iter_metadata()]
        assert names == ["massid", "massid", "rosbag2"]
    with log.open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True, validate_crcs=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    assert len(chunks) > 3
    for chunk in chunks:
        assert chunk.compression == "zstd"
        assert chunk.uncompressed_crc != 0
        assert chunk.uncompressed_size <= 256 * 1024 + 8192  # the first also holds schemas and channels


def test_rosbag2_metadata_tells_topics_and_counts(log, samples):
    with log.open("rb") as stream:
        record = next(r for r in make_reader(stream).iter_metadata() if r.name == "rosbag2")
    content = YAML(typ="safe").load(record.metadata["serialized_metadata"])
    assert content["storage_identifier"] == "mcap"
    assert content["message_count"] == 4 * len(samples)
    assert content["starting_time"]["nanoseconds_since_epoch"] == START_NS
    assert content["duration"]["nanoseconds"] == (len(samples) - 1) * STEP_NS
    topics = {t["topic_metadata"]["name"]: t for t in content["topics_with_message_count"]}
    assert topics["/odom"]["message_count"] == len(samples)
    assert YAML(typ="safe").load(topics["/odom"]["topic_metadata"]["offered_qos_profiles"])[0]["durability"] == 2
    assert content["files"][0]["path"] == "walk.mcap"


def test_an_exception_leaves_a_readable_log_that_says_why(tmp_path, samples):
    path = tmp_path / "walk.mcap"

    def record() -> None:
        with WalkWriter(path, root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
            writer.append_block(*samples.block(0, 333))
            raise RuntimeError("the simulation\nexploded")

    with pytest.raises(RuntimeError, match="exploded"):
        record()
    walk = read_walk(path)
    assert_same(walk, samples, slice(0, 333))
    assert walk.metadata["end"] == "RuntimeError: the simulation exploded"
    assert walk.warnings == (f"{path}: the recording ended early: RuntimeError: the simulation exploded.",)


def test_the_caller_may_say_why_the_log_ends(tmp_path, samples):
    path = tmp_path / "walk.mcap"
    with WalkWriter(path, root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
        writer.append_block(*samples.block(0, 333))
        writer.end_because("fell")
    assert read_walk(path).metadata["end"] == "fell"


KILLED = """
import os, signal, sys
sys.path.insert(0, sys.argv[1])
from tests.log.samples import JOINTS, ROOT, make_samples
from massid.log import WalkWriter
samples = make_samples(1000)
writer = WalkWriter(sys.argv[2], root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3)
for k in range(int(sys.argv[3])):
    writer.append_block(*samples.block(k, k + 1))
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("written", [400, 777])
def test_a_killed_writer_loses_less_than_one_chunk(tmp_path, samples, written):
    path = tmp_path / "walk.mcap"
    command = [sys.executable, "-c", KILLED, os.fspath(Path(__file__).parents[2]), os.fspath(path), str(written)]
    killed = subprocess.run(command, check=False)
    assert killed.returncode == -signal.SIGKILL
    assert not path.exists()
    walk = read_walk(tmp_path / "walk.mcap.partial")
    per_chunk = 256 * 1024 // sum(len(raw) + 31 for raw in _first_messages(tmp_path / "walk.mcap.partial"))
    assert written - per_chunk < len(walk) <= written
    assert_same(walk, samples, slice(0, len(walk)))
    assert "not closed or cut off" in walk.warnings[0]
    assert "end" not in walk.metadata


def _first_messages(path: Path) -> list[bytes]:
    found: dict[int, bytes] = {}
    with path.open("rb") as stream:
        for record in StreamReader(stream).records:
            if hasattr(record, "log_time"):
                if record.channel_id in found:
                    break
                found[record.channel_id] = record.data
    return list(found.values())


def bad_nan(samples):
    samples.effort[3, 1] = np.nan


def bad_quaternion(samples):
    samples.qpos[3, 3:7] = 0.0


def bad_stamp(samples):
    samples.stamps[3] = samples.stamps[2]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (bad_nan, r"effort is nan at sample 103, column 1"),
        (bad_quaternion, r"base quaternion of sample 103 is \[0. 0. 0. 0.\], expected unit norm"),
        (bad_stamp, r"sample 103 has the stamp \d+ ns, expected more than \d+ ns"),
    ],
)
def test_the_writer_refuses_bad_samples_and_keeps_the_good_ones(tmp_path, samples, spoil, message):
    path = tmp_path / "walk.mcap"
    later = make_samples(100, seed=1)
    later.stamps[:] += 100 * STEP_NS
    spoil(later)

    def record() -> None:
        with WalkWriter(path, root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
            writer.append_block(*samples.block(0, 100))
            writer.append_block(*later.block(0, 100))

    with pytest.raises(LogError, match=message):
        record()
    walk = read_walk(path)
    assert_same(walk, samples, slice(0, 100))
    assert walk.metadata["end"].startswith("LogError: ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"joint_names": ("a", "a")}, "joint name 'a' occurs more than once"),
        ({"contact_bodies": ("f", "f")}, "contact body name 'f' occurs more than once"),
        ({"metadata": {"seed": 3}}, "metadata must be text, but 'seed' is 3"),
        ({"metadata": {"end": "x"}}, "metadata key 'end' is written by the recorder"),
        ({"timestep_s": 0.0}, "timestep is 0.0 s, expected more than 0"),
    ],
)
def test_the_writer_refuses_bad_options(tmp_path, options, message):
    with pytest.raises(LogError, match=message):
        WalkWriter(tmp_path / "walk.mcap", **{"root_body": ROOT, "joint_names": JOINTS, "timestep_s": 1e-3, **options})
    assert list(tmp_path.iterdir()) == []


def test_the_writer_names_a_wrong_shape(tmp_path, samples):
    with WalkWriter(tmp_path / "walk.mcap", root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
        writer.append_block(*samples.block(0, 10))
        stamps, qpos, qvel, effort, _ = samples.block(10, 20)
        with pytest.raises(LogError, match=r"effort has shape \(10, 3\), expected \(10, 4\)"):
            writer.append_block(stamps, qpos, qvel, effort[:, :3], {})
        with pytest.raises(LogError, match=r"wrench of 'l_foot' has shape \(10, 3\), expected \(10, 6\)"):
            writer.append_block(stamps, qpos, qvel, effort, {"l_foot": np.zeros((10, 3))})
        with pytest.raises(LogError, match=r"type float64, expected \(n,\) integers"):
            writer.append_block(stamps * 1e-9, qpos, qvel, effort, {})
    assert len(read_walk(tmp_path / "walk.mcap")) == 10


def test_an_empty_recording_leaves_no_file(tmp_path):
    options = {"root_body": ROOT, "joint_names": JOINTS, "timestep_s": 1e-3}
    with (
        pytest.raises(LogError, match="no sample was recorded, so no log was written"),
        WalkWriter(tmp_path / "walk.mcap", **options),
    ):
        pass
    with pytest.raises(ZeroDivisionError), WalkWriter(tmp_path / "walk.mcap", **options):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


def test_a_closed_writer_takes_no_samples(tmp_path, samples):
    with WalkWriter(tmp_path / "walk.mcap", root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3) as writer:
        writer.append_block(*samples.block(0, 10))
    writer.close()
    with pytest.raises(LogError, match="the log is closed"):
        writer.append_block(*samples.block(10, 20))


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(LogError, match=r"nowhere/walk\.mcap\.partial: cannot be written: No such file"):
        WalkWriter(tmp_path / "nowhere" / "walk.mcap", root_body=ROOT, joint_names=JOINTS, timestep_s=1e-3)
