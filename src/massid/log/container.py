"""Walk through an MCAP file from front to back, check every checksum, and keep what is sound of a damaged one."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, Metadata, MessageIndex, Schema

from massid.errors import LogError

MAGIC = b"\x89MCAP0\r\n"
_FOOTER_BYTES = 1 + 8 + 20
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<BQH")
_MESSAGE_HEADER = 22
_DAMAGE = (McapError, struct.error, UnicodeDecodeError, ValueError, RuntimeError, MemoryError, OverflowError)
_BATCH = 1024
_OTHER_FORMATS = {
    b"SQLite format 3": "a rosbag2 SQLite file: convert it with `ros2 bag convert`",
    b"#ROSBAG V2.0": "a ROS 1 bag: convert it to MCAP with `mcap convert`",
    b"\x28\xb5\x2f\xfd": "a zstd-compressed file: decompress it first",
    b"\x1f\x8b": "a gzip-compressed file: decompress it first",
    b"PK\x03\x04": "a zip or NumPy .npz archive",
}


@dataclass(frozen=True)
class TopicInfo:
    """What the file says about a topic before any message is decoded."""

    topic: str
    message_type: str
    message_encoding: str
    schema_encoding: str
    schema_text: str


@dataclass
class Contents:
    """What a file was found to hold; filled while it is read.

    Attributes:
        topics: every topic by name.
        metadata: metadata records by name; of records with one name later keys replace earlier ones.
        warnings: damage and loss, one line each.
    """

    topics: dict[str, TopicInfo] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def read_messages(
    path: Path, uses: Callable[[str], bool], receive: Callable[[TopicInfo, list[bytes]], None]
) -> Contents:
    """Hand over the messages of the topics in use, in the order of the file.

    Args:
        path: the MCAP file, finished or cut off.
        uses: tells whether a topic is of interest.
        receive: takes a batch of messages of one topic.

    Returns:
        What else was found, with a line for each loss.

    Raises:
        LogError: there is no such file, or it is not MCAP; says what it is instead.
    """
    check_is_mcap(path)
    try:
        with path.open("rb") as stream:
            return _Scan(path, stream, uses, receive).run()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from error


def check_is_mcap(path: Path) -> None:
    """Raise a LogError that names what was found unless `path` is a file that begins as MCAP does."""
    if path.is_dir():
        logs = sorted(entry.name for entry in path.glob("*.mcap"))
        inside = f"it holds {', '.join(logs)}" if logs else "it holds no .mcap file"
        raise LogError(f"{path}: is a folder, expected an MCAP file; {inside}.")
    if not path.exists():
        near = sorted(entry.name for entry in path.parent.glob("*.mcap*")) if path.parent.is_dir() else []
        there = f"{path.parent} has {', '.join(near)}" if near else f"{path.parent} has no MCAP file"
        raise LogError(f"{path}: does not exist; {there}.")
    try:
        with path.open("rb") as stream:
            start = stream.read(24)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from error
    if start.startswith(MAGIC):
        return
    if not start:
        raise LogError(f"{path}: is empty, expected an MCAP file.")
    for magic, name in _OTHER_FORMATS.items():
        if start.startswith(magic):
            raise LogError(f"{path}: is not MCAP but {name}.")
    printable = start.decode("latin-1").isprintable() or start.decode("latin-1").split("\n")[0].isprintable()
    shown = repr(start.decode("latin-1").splitlines()[0]) if printable else f"the bytes {start[:8].hex(' ')}"
    raise LogError(f"{path}: is not an MCAP file; it begins with {shown}, expected {MAGIC.hex(' ')}.")


class _Scan:
    """One pass over one file."""

    def __init__(
        self,
        path: Path,
        stream: IO[bytes],
        uses: Callable[[str], bool],
        receive: Callable[[TopicInfo, list[bytes]], None],
    ) -> None:
        self.path = path
        self.stream = stream
        self.size = path.stat().st_size
        self.uses = uses
        self.receive = receive
        self.found = Contents()
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, TopicInfo] = {}
        self.pending: dict[int, list[bytes]] = {}
        self.orphans: Counter[int] = Counter()  # messages whose channel is not defined (yet)
        self.lost: Counter[int] = Counter()
        self.damaged: list[str] = []  # where and why, in the order of the file
        self.uncounted = 0  # damaged chunks of unknown content
        self.index: dict[int, ChunkIndex] = {}  # by offset of the chunk
        self.awaiting_counts = False

    def run(self) -> Contents:
        self.read_summary()
        self.walk()
        for channel in list(self.pending):
            self.hand_over(channel)
        self.state_losses()
        return self.found

    def warn(self, text: str) -> None:
        self.found.warnings.append(f"{self.path}: {text}")

    def read_summary(self) -> None:
        """Take definitions and chunk positions from the end of the file, if it has a sound one."""
        self.stream.seek(max(0, self.size - _FOOTER_BYTES - len(MAGIC)))
        tail = self.stream.read()
        if not tail.endswith(MAGIC) or tail[:9] != _RECORD.pack(Opcode.FOOTER, 20):
            return
        start, _, crc = struct.unpack_from("<QQI", tail, 9)
        if start == 0:
            return
        length = self.size - len(tail) - start
        if length < 0:
            self.warn("the index at its end is damaged; the data is read without it.")
            return
        self.stream.seek(start)
        summary = self.stream.read(length)
        if crc not in (0, zlib.crc32(tail[:25], zlib.crc32(summary))):
            self.warn("the index at its end is damaged (checksum); the data is read without it.")
            return
        position = 0
        while position + _RECORD.size <= len(summary):
            opcode, size = _RECORD.unpack_from(summary, position)
            position += _RECORD.size
            content = summary[position : position + size]
            position += size
            if opcode == Opcode.CHUNK_INDEX:
                index = _parse(ChunkIndex, content)
                self.index[index.chunk_start_offset] = index
            else:
                self.define(opcode, content)

    def records(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield opcode, position and content of each record of the data section.

        A broken length would lead astray: the known chunk positions bring the walk back on its way.
        """
        position, checksum, broken = len(MAGIC), zlib.crc32(MAGIC), False
        chunks = sorted(self.index)
        while True:
            self.stream.seek(position)
            head = self.stream.read(_RECORD.size)
            while chunks and chunks[0] < position:
                chunks.pop(0)
            opcode, size = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, self.size)
            end = position + _RECORD.size + size
            if end > self.size or (chunks and position < chunks[0] < end):
                if not chunks:
                    left = self.size - position
                    self.warn(f"cut off or damaged at byte {position}: the last {left} bytes are lost.")
                    return
                broken = True
                self.damaged.append(f"at byte {position} a record is broken")
                self.lose_until(position, chunks[0] + (chunks[0] == position))
                if chunks[0] == position:
                    chunks.pop(0)
                if not chunks:
                    return
                position = chunks[0]
                continue
            content = self.stream.read(size)
            if opcode == Opcode.DATA_END:
                expected = _parse(DataEnd, content).data_section_crc
                if expected not in (0, checksum) and not (broken or self.damaged):
                    self.warn("damaged outside its chunks (checksum): metadata and topic names may be wrong.")
                return
            checksum = zlib.crc32(content, zlib.crc32(head, checksum))
            yield opcode, position, content
            position = end

    def lose_until(self, start: int, stop: int) -> None:
        """Count the messages of the indexed chunks that begin in [start, stop)."""
        for offset, index in self.index.items():
            if start <= offset < stop:
                self.lost.update(_indexed_counts(index))

    def walk(self) -> None:
        for opcode, position, content in self.records():
            if opcode == Opcode.CHUNK:
                self.awaiting_counts = False
                self.read_chunk(position, content)
            elif opcode == Opcode.MESSAGE:
                self.take(struct.unpack_from("<H", content)[0], content[_MESSAGE_HEADER:])
            elif opcode == Opcode.MESSAGE_INDEX and self.awaiting_counts:
                self.count_from_index(content)
            elif opcode == Opcode.METADATA:
                self.read_metadata(position, content)
            else:
                self.try_define(opcode, position, content)

    def read_chunk(self, position: int, content: bytes) -> None:
        try:
            data = _decompress(_parse(Chunk, content))
        except _DAMAGE as error:
            self.damaged.append(f"at byte {position}: {error}")
            if position in self.index:
                self.lost.update(_indexed_counts(self.index[position]))
            else:
                self.awaiting_counts = True
                self.uncounted += 1
            return
        at, end = 0, len(data)
        unpack, pending = _MESSAGE.unpack_from, self.pending
        while at + _RECORD.size < end:
            if data[at] == Opcode.MESSAGE:
                _, size, channel = unpack(data, at)
                stop = at + _RECORD.size + size
                try:
                    pending[channel].append(data[at + _RECORD.size + _MESSAGE_HEADER : stop])
                except KeyError:
                    self.take(channel, data[at + _RECORD.size + _MESSAGE_HEADER : stop])
            else:
                opcode, size = _RECORD.unpack_from(data, at)
                stop = at + _RECORD.size + size
                self.try_define(opcode, position, data[at + _RECORD.size : stop])
            at = stop
        for channel, messages in pending.items():
            if len(messages) >= _BATCH:
                self.hand_over(channel)

    def count_from_index(self, content: bytes) -> None:
        try:
            index = _parse(MessageIndex, content)
        except _DAMAGE:
            return
        if self.damaged and not self.damaged[-1].endswith(" "):
            self.damaged[-1] += " "  # counted once
            self.uncounted -= 1
        self.lost[index.channel_id] += len(index.records)

    def take(self, channel: int, message: bytes) -> None:
        info = self.channels.get(channel)
        if info is None:
            self.orphans[channel] += 1
        elif self.uses(info.topic):
            self.pending.setdefault(channel, []).append(message)
            if len(self.pending[channel]) >= _BATCH:
                self.hand_over(channel)

    def hand_over(self, channel: int) -> None:
        messages, self.pending[channel] = self.pending[channel], []
        if messages:
            self.receive(self.channels[channel], messages)
