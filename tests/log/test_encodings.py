"""Other encodings, compressions and definitions of messages give the same walk, or are named."""

from __future__ import annotations

import lz4.frame
import pytest
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType
from rosbags.typesys import Stores, get_typestore

from massid.errors import LogError
from massid.log import read_walk
from tests.log.samples import TYPES, as_ros1, assert_same, make_samples

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
