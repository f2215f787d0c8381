"""Whatever happens to a file: what is sound is read, what is lost is said, and nothing wrong comes out."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode

from massid.errors import LogError
from massid.log import read_walk, repair_log
from tests.log.samples import Samples, assert_same, make_samples, write_samples

MAGIC = b"\x89MCAP0\r\n"


@pytest.fixture(scope="module")
def short() -> Samples:
    return make_samples(500)


@pytest.fixture(scope="module")
def content(short, tmp_path_factory) -> bytes:
    return write_samples(tmp_path_factory.mktemp("log") / "walk.mcap", short).read_bytes()


def records(content: bytes, opcode: Opcode) -> list[int]:
    """Positions of the records with an opcode."""
    found, position = [], len(MAGIC)
    while position < len(content) - len(MAGIC):
        kind, size = struct.unpack_from("<BQ", content, position)
        if kind == opcode:
            found.append(position)
        position += 9 + size
    return found


def assert_sound_part(path: Path, samples: Samples) -> int:
    """Whatever is read equals what was written, any loss is stated; return how many samples came back."""
    try:
        walk = read_walk(path)
    except LogError as error:
        assert str(path) in str(error)
        assert "\n" not in str(error)
        return 0
    assert walk.warnings
    assert all(line.startswith(f"{path}: ") for line in walk.warnings)
    rows = np.searchsorted(samples.stamps, walk.stamps_ns)
    assert_same(walk, samples, rows)
    for segment in walk.segments:
        assert (np.diff(rows[segment.start : segment.stop]) == 1).all()
    return len(walk)


def test_a_file_cut_anywhere_gives_what_came_before(tmp_path, content, short):
    path = tmp_path / "cut.mcap"
    ends = [*records(content, Opcode.CHUNK), *records(content, Opcode.DATA_END), *records(content, Opcode.FOOTER)]
    cuts = {*np.linspace(0, len(content) - 1, 60).astype(int), *(e + d for e in ends for d in (-1, 0, 1, 9, 30))}
    previous = 0
    for cut in sorted(cuts):
        path.write_bytes(content[:cut])
        found = assert_sound_part(path, short)
        assert found >= previous
        previous = found
    assert previous == len(short)


def test_no_flipped_byte_goes_unnoticed(tmp_path, content, short):
    path = tmp_path / "flipped.mcap"
    rng = np.random.default_rng(7)
    heads = [p + d for kind in Opcode for p in records(content, kind) for d in (0, 1, 2, 5, 8, 9, 20)]
    places = {*rng.integers(0, len(content), 150).tolist(), *(p for p in heads if p < len(content))}
    for place in sorted(places):
        spoiled = bytearray(content)
        spoiled[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(spoiled)
        assert_sound_part(path, short)


@pytest.fixture(scope="module")
def per_chunk(content) -> list[int]:
    """Samples of each chunk, from the indexes of one channel."""
    counts = Counter()
    chunks = records(content, Opcode.CHUNK)
    for position in records(content, Opcode.MESSAGE_INDEX):
        channel, size = struct.unpack_from("<HI", content, position + 9)
        if channel == 1:
            counts[sum(chunk < position for chunk in chunks) - 1] += size // 16
    return [counts[k] for k in range(len(chunks))]


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("chunk", [0, 1])
def test_a_damaged_chunk_is_left_out_and_counted(tmp_path, content, short, per_chunk, chunk, closed):
    assert len(per_chunk) >= 2
    assert sum(per_chunk) == len(short)
    spoiled = bytearray(content)
    spoiled[records(content, Opcode.CHUNK)[chunk] + 5000] ^= 4
    end = len(content) if closed else records(content, Opcode.DATA_END)[0]
    path = tmp_path / "damaged.mcap"
    path.write_bytes(spoiled[:end])
    if chunk == 0 and not closed:  # the only definitions of the topics are gone
        with pytest.raises(LogError, match=r"no base state: topic /odom is not in the log.*is damaged"):
            read_walk(path)
        return
    walk = read_walk(path)
    lost = per_chunk[chunk]
    assert len(walk) == len(short) - lost
    for topic in ("/odom", "/joint_states", "/contact/l_foot", "/contact/r_foot"):
        assert f"{path}: {topic}: {lost} samples lost in damaged parts of the file." in walk.warnings
    first = sum(per_chunk[:chunk])
    rows = np.delete(np.arange(len(short)), slice(first, first + lost))
    assert_same(walk, short, rows)
    inside = 0 < chunk < len(per_chunk) - 1
    assert len(walk.segments) == (2 if inside else 1)


def test_a_broken_record_length_does_not_lead_astray(tmp_path, content, short, per_chunk):
    spoiled = bytearray(content)
    spoiled[records(content, Opcode.CHUNK)[1] + 3] ^= 0x40
    path = tmp_path / "broken.mcap"
    path.write_bytes(spoiled)
    walk = read_walk(path)
    assert len(walk) == len(short) - per_chunk[1]
    assert f"{path}: /odom: {per_chunk[1]} samples lost in damaged parts of the file." in walk.warnings


def test_damaged_metadata_is_said_though_no_sample_is_lost(tmp_path, short):
    path = write_samples(tmp_path / "walk.mcap", short, metadata={"model": "atlas.xml"})
    path.write_bytes(path.read_bytes().replace(b"atlas.xml", b"atlas.xmm"))
    walk = read_walk(path)
    assert len(walk) == len(short)
    assert walk.warnings == (f"{path}: damaged outside its chunks (checksum): metadata may be wrong.",)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty, expected an MCAP file"),
        (MAGIC[:5], "is cut off after 5 bytes"),
        (b"time,q1,q2\n0.0,1,2\n", "is not an MCAP file; it begins with the text 'time,q1,q2'"),
        (b"\x00\x01\x02\x03\xff", "is not an MCAP file; it begins with the bytes 00 01 02 03 ff"),
        (b"\n\n", "is not an MCAP file; it begins with the bytes 0a 0a"),
        (b"SQLite format 3\0", "is a rosbag2 SQLite file, but not named so: expected NAME.db3"),
        (b"#ROSBAG V2.0\n", "a ROS 1 bag that cannot be read"),
        (MAGIC, "no base state: topic /odom is not in the log.*The log has: no topics"),
    ],
)
def test_a_file_that_is_no_log_is_named(tmp_path, content, message):
    path = tmp_path / "walk.mcap"
    path.write_bytes(content)
    with pytest.raises(LogError, match=message) as caught:
        read_walk(path)
    assert "\n" not in str(caught.value)


def test_a_numpy_archive_of_no_numbers_is_named(tmp_path):
    with zipfile.ZipFile(tmp_path / "walk.npz", "w") as archive:
        archive.writestr("qpos.npy", b"")
    with pytest.raises(LogError, match=r"walk.npz: holds no column of numbers"):
        read_walk(tmp_path / "walk.npz")


def test_a_missing_file_and_a_folder_say_what_is_there(tmp_path, content):
    with pytest.raises(LogError, match=r"walk.mcap: does not exist; the folder .* has no MCAP file"):
        read_walk(tmp_path / "walk.mcap")
    (tmp_path / "other.mcap").write_bytes(content)
    with pytest.raises(LogError, match=r"walk.mcap: does not exist; the folder .* has other.mcap"):
        read_walk(tmp_path / "walk.mcap")
    with pytest.raises(
        LogError, match=r"is a folder, expected a log or a folder of `ros2 bag record`.*; it has other.mcap"
    ):
        read_walk(tmp_path)


def with_summary(content: bytes, change: Callable[[int, bytearray], None]) -> bytes:
    """A log whose index at the end was changed, record by record, with a checksum that agrees."""
    footer = records(content, Opcode.FOOTER)[0]
    (start,) = struct.unpack_from("<Q", content, footer + 9)
    summary, position = bytearray(), start
    while position < footer:
        kind, size = struct.unpack_from("<BQ", content, position)
        record = bytearray(content[position : position + 9 + size])
        change(kind, record)
        summary += record
        position += 9 + size
    tail = content[footer : footer + 25]
    crc = zlib.crc32(tail, zlib.crc32(summary))
    return content[:start] + bytes(summary) + tail + struct.pack("<I", crc) + MAGIC


def shift_all(kind: int, record: bytearray) -> None:
    if kind == Opcode.CHUNK_INDEX:
        struct.pack_into("<Q", record, 25, struct.unpack_from("<Q", record, 25)[0] + 7)


def forget_first(kind: int, record: bytearray) -> None:
    if kind == Opcode.CHUNK_INDEX and not forget_first.__dict__.setdefault("done", False):
        forget_first.__dict__["done"] = True
        record.clear()


def at_message_indexes(kind: int, record: bytearray) -> None:
    if kind == Opcode.CHUNK_INDEX:
        start, length = struct.unpack_from("<QQ", record, 25)
        struct.pack_into("<Q", record, 25, start + length)


def swap_channels(kind: int, record: bytearray) -> None:
    if kind == Opcode.CHANNEL:
        (number,) = struct.unpack_from("<H", record, 9)
        struct.pack_into("<H", record, 9, 3 - number if number < 3 else number)


@pytest.mark.parametrize("change", [shift_all, forget_first, at_message_indexes, swap_channels])
def test_an_index_that_contradicts_the_data_is_not_believed(tmp_path, content, short, change):
    forget_first.__dict__["done"] = False
    path = tmp_path / "indexed.mcap"
    path.write_bytes(with_summary(content, change))
    walk = read_walk(path)
    assert_same(walk, short)
    assert len(walk.warnings) == 1
    assert "index at the end" in walk.warnings[0]
    repaired = repair_log(path, tmp_path / "repaired.mcap")
    assert repaired.messages["/odom"] == len(short)
    assert read_walk(repaired.path).warnings == ()


def test_an_unchanged_index_is_believed(tmp_path, content):
    path = tmp_path / "indexed.mcap"
    path.write_bytes(with_summary(content, lambda kind, record: None))
    assert path.read_bytes() == content
    assert read_walk(path).warnings == ()


@pytest.mark.parametrize("end", [None, Opcode.DATA_END], ids=["whole", "without its end"])
def test_logs_that_were_pasted_together_give_both(tmp_path, content, short, end):
    later = replace(short, stamps=short.stamps + short.stamps[-1] - short.stamps[0] + 1_000_000)
    second = write_samples(tmp_path / "second.mcap", later).read_bytes()
    first = content if end is None else content[: records(content, end)[0]]
    path = tmp_path / "both.mcap"
    path.write_bytes(first + second)
    walk = read_walk(path)
    assert len(walk) == 2 * len(short)
    assert f"{path}: another log begins at byte {len(first)}: both are read, as one log." in walk.warnings
    np.testing.assert_array_equal(walk.qpos, np.concatenate([short.qpos, short.qpos]))
    repaired = repair_log(path, tmp_path / "repaired.mcap")
    assert repaired.messages["/odom"] == 2 * len(short)


def test_a_log_that_was_pasted_to_itself_is_read_once(tmp_path, content, short):
    path = tmp_path / "twice.mcap"
    path.write_bytes(content + content)
    walk = read_walk(path)
    assert_same(walk, short)
    assert any("both are read" in line for line in walk.warnings)
    assert any("stand in the log twice" in line for line in walk.warnings)
