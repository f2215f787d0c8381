"""The same messages in other containers are the same walk."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import rosbags.rosbag1
import rosbags.rosbag2
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from massid.errors import LogError
from massid.log import read_walk, summarise_log
from massid.walk import Segment
from tests.log.samples import Foreign, as_ros1, assert_same, make_samples, write_samples

N = 60


def stamp_of(message) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def as_rosbag2(log: Foreign, folder: Path, plugin: StoragePlugin) -> Path:
    with rosbags.rosbag2.Writer(folder, version=9, storage_plugin=plugin) as writer:
        for topic, messages in log.messages.items():
            connection = writer.add_connection(topic, log.types[topic], typestore=log.store)
            for message in messages:
                writer.write(connection, stamp_of(message), log.store.serialize_cdr(message, log.types[topic]))
    return folder


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_folder_of_rosbag2_is_a_log(foreign, tmp_path: Path, plugin) -> None:
    folder = as_rosbag2(foreign(N), tmp_path / "bag", plugin)
    assert_same(read_walk(folder), make_samples(N))
    assert {topic.info.topic for topic in summarise_log(folder).topics} >= {"/odom", "/joint_states"}


def test_a_sqlite_file_is_read_without_its_folder(foreign, tmp_path: Path) -> None:
    (path,) = as_rosbag2(foreign(N), tmp_path / "bag", StoragePlugin.SQLITE3).glob("*.db3")
    assert_same(read_walk(path), make_samples(N))


def test_a_ros_1_bag_is_read(foreign, tmp_path: Path) -> None:
    log, ros1 = foreign(N), get_typestore(Stores.ROS1_NOETIC)
    with rosbags.rosbag1.Writer(tmp_path / "walk.bag") as writer:
        for topic, messages in log.messages.items():
            connection = writer.add_connection(topic, log.types[topic], typestore=ros1)
            for message in messages:
                writer.write(connection, stamp_of(message), as_ros1(message, log.types[topic]))
    assert_same(read_walk(tmp_path / "walk.bag"), make_samples(N))


@pytest.mark.parametrize("listed", [True, False])
def test_a_bag_that_was_split_is_one_log(foreign, tmp_path: Path, listed) -> None:
    folder = tmp_path / "walk"
    folder.mkdir()
    for part, rows in enumerate((range(25), range(25, 26), range(26, N))):
        log = foreign(N)
        for topic in log.messages:
            log.drop(topic, set(range(N)) - set(rows))
        shutil.move(log.write(), folder / f"walk_{part}.mcap")
    if listed:
        names = ", ".join(f"walk_{part}.mcap" for part in range(3))
        (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {{relative_file_paths: [{names}]}}\n")
    walk = read_walk(folder)
    assert_same(walk, make_samples(N))
    assert walk.segments == (Segment(0, N),)
    assert bool(walk.warnings) is not listed


def test_a_lost_file_of_a_bag_is_a_gap_and_said(foreign, tmp_path: Path) -> None:
    folder = tmp_path / "walk"
    folder.mkdir()
    for part, rows in ((0, range(20)), (2, range(40, N))):
        log = foreign(N)
        for topic in log.messages:
            log.drop(topic, set(range(N)) - set(rows))
        shutil.move(log.write(), folder / f"walk_{part}.mcap")
    names = ", ".join(f"walk_{part}.mcap" for part in range(3))
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information: {{relative_file_paths: [{names}]}}\n")
    walk = read_walk(folder)
    assert_same(walk, make_samples(N), np.r_[0:20, 40:N])
    assert walk.segments == (Segment(0, 20), Segment(20, 40))
    assert any("walk_1.mcap is listed in metadata.yaml, but is not there" in line for line in walk.warnings)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("just text", "metadata.yaml: is not the metadata of a bag"),
        ("rosbag2_bagfile_information: {relative_file_paths: [../../secret.mcap]}", "none of the files .* is there"),
        (None, "is a folder, expected a log or a folder of `ros2 bag record`.*; it has a.mcap, b.mcap"),
    ],
)
def test_a_folder_that_is_no_bag_is_refused(foreign, tmp_path: Path, content, message) -> None:
    folder = tmp_path / "walks"
    folder.mkdir()
    path = foreign(4).write()
    shutil.copy(path, tmp_path / "secret.mcap")
    for name in ("a.mcap", "b.mcap"):
        shutil.copy(path, folder / name)
    if content is not None:
        (folder / "metadata.yaml").write_text(content)
    with pytest.raises(LogError, match=message):
        read_walk(folder)


@pytest.mark.parametrize("start", [b"SQLite format 3\0", b"#ROSBAG V2.0\n"])
def test_a_damaged_bag_is_one_line(tmp_path: Path, start) -> None:
    path = tmp_path / ("walk.db3" if start.startswith(b"SQ") else "walk.bag")
    path.write_bytes(start + bytes(range(256)) * 40)
    with pytest.raises(LogError, match=r"that cannot be read: ") as caught:
        read_walk(path)
    assert "\n" not in str(caught.value)


def test_what_a_killed_command_left_beside_a_bag_is_no_part_of_it(tmp_path: Path) -> None:
    samples = make_samples(40)
    write_samples(tmp_path / "walk_0.mcap", samples)
    (tmp_path / ".massid-0123456789ab.partial.mcap").write_bytes(b"half of a log")
    assert len(read_walk(tmp_path)) == len(samples)
    with pytest.raises(LogError, match=r"has walk_0\.mcap\.$"):
        read_walk(tmp_path / "other.mcap")
