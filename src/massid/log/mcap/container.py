"""Walk through an MCAP file from front to back, check every checksum, keep what is sound of a damaged one."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, DataEnd, MessageIndex, Metadata, Schema

from massid.errors import LogError
from massid.log.files import MAGIC

_RECORD = struct.Struct("<BQ")  # opcode, length
_MESSAGE = struct.Struct("<BQH")  # opcode, length, channel
MESSAGE_HEAD = 22
"""Bytes of a message record before the message: channel, sequence, log time and publish time."""
NO_CHECKSUM = "carry no checksum"
_LARGEST_CHUNK = 1 << 31
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, checksum
_DATA_END_BYTES = 4
_INDEX_HEAD, _INDEX_ENTRY = _RECORD.size + 6, 16
_DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    RuntimeError,
    MemoryError,
    OverflowError,
)
_BATCH = 1024


@dataclass(frozen=True)
class TopicInfo:
    """What the file says about a topic before any message is decoded."""

    topic: str
    message_type: str
    message_encoding: str
    schema_encoding: str
    schema_data: bytes
    metadata: tuple[tuple[str, str], ...] = ()

    @property
    def schema_text(self) -> str:
        """The schema, if it is text."""
        return self.schema_data.decode("utf-8", errors="replace")


@dataclass(frozen=True)
class Contents:
    """What a file was found to hold besides the messages that were handed over.

    Attributes:
        topics: every topic by name.
        metadata: metadata records by name; of records with one name later keys replace earlier ones.
        warnings: damage and loss, one line each, without the name of the file.
    """

    topics: Mapping[str, TopicInfo]
    metadata: Mapping[str, Mapping[str, str]]
    warnings: tuple[str, ...]


def read_mcap(path: Path, uses: Callable[[str], bool], receive: Callable[[TopicInfo, list[bytes]], None]) -> Contents:
    """Hand over the messages of the topics in use, in the order of the file.

    Args:
        path: an MCAP file, finished or cut off.
        uses: tells whether a topic is of interest.
        receive: takes a batch of messages of one topic: for each its record, `MESSAGE_HEAD` bytes and the message.

    Returns:
        What else was found, with a line for each loss.

    Raises:
        LogError: the file cannot be read.
    """
    try:
        with path.open("rb") as stream:
            scan = _Scan(stream, path.stat().st_size, uses, receive)
            scan.run()
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from error
    topics = {info.topic: info for info in scan.channels.values()}
    return Contents(topics, scan.metadata, (*scan.warnings, *scan.losses()))


@dataclass
class _Damage:
    """A part of the file that cannot be used, and the messages in it by channel if an index tells."""

    position: int
    reason: str
    lost: Counter[int] | None = None


class _Scan:
    """One pass over one file."""

    def __init__(
        self,
        stream: IO[bytes],
        size: int,
        uses: Callable[[str], bool],
        receive: Callable[[TopicInfo, list[bytes]], None],
    ) -> None:
        self.stream = stream
        self.size = size
        self.uses = uses
        self.receive = receive
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, TopicInfo] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.warnings: list[str] = []
        self.damages: list[_Damage] = []
        self.closed = False
        self.chunks: dict[int, ChunkIndex] = {}  # by position of the chunk
        self.pending: dict[int, list[bytes]] = {}  # messages to hand over, by channel
        self.shared: dict[int, set[int]] = {}  # channels of topics that have several, and which these are
        self.orphans: Counter[int] = Counter()  # messages of channels that nothing defines
        self.unchecked = 0  # chunks, and messages outside of chunks, that no checksum protects
        self.unchunked = 0  # messages outside of chunks

    def run(self) -> None:
        try:
            self.read_summary()
        except _DAMAGE as error:
            self.warnings.append(f"the index at the end is damaged ({error}); the data is read without it.")
        uncounted: _Damage | None = None  # the chunk whose message indexes follow next
        for opcode, position, content in self.records():
            if opcode == Opcode.CHUNK:
                uncounted = self.read_chunk(position, content)
            elif opcode == Opcode.MESSAGE_INDEX:
                if uncounted is not None:
                    self.count_from_index(uncounted, content)
            else:
                uncounted = None
                self.read_record(opcode, position, content)
        for channel in self.pending:
            self.hand_over(channel)

    def read_summary(self) -> None:
        """Take definitions and chunk positions from the end of the file, if it was closed."""
        self.stream.seek(max(0, self.size - _FOOTER.size - len(MAGIC)))
        tail = self.stream.read()
        self.closed = len(tail) == _FOOTER.size + len(MAGIC) and tail.endswith(MAGIC)
        if not self.closed:
            return
        opcode, _, start, _, checksum = _FOOTER.unpack_from(tail)
        if opcode == Opcode.FOOTER and start == 0:
            return
        length = self.size - len(tail) - start
        if opcode != Opcode.FOOTER or length < 0:
            raise ValueError("its position is impossible")
        self.stream.seek(start)
        summary = self.stream.read(length)
        if checksum not in (0, zlib.crc32(tail[: _FOOTER.size - 4], zlib.crc32(summary))):
            raise ValueError("wrong checksum")
        position = 0
        while position < length:
            opcode, size = _RECORD.unpack_from(summary, position)
            content = summary[position + _RECORD.size : position + _RECORD.size + size]
            position += _RECORD.size + size
            if opcode == Opcode.CHUNK_INDEX:
                index = _parse(ChunkIndex, content)
                self.chunks[index.chunk_start_offset] = index
            else:
                self.define(opcode, content)

    def records(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield opcode, position and content of each record of the data section.

        A broken length leads astray; the chunk positions that the summary tells bring the walk back.
        """
        position, checksum = len(MAGIC), zlib.crc32(MAGIC)
        ahead = sorted(self.chunks, reverse=True)
        while True:
            while ahead and ahead[-1] < position:
                ahead.pop()
            self.stream.seek(position)
            head = self.stream.read(_RECORD.size)
            opcode, size = _RECORD.unpack(head) if len(head) == _RECORD.size else (0, self.size)
            end = position + _RECORD.size + size
            on_chunk = bool(ahead) and ahead[-1] == position
            if on_chunk:
                ahead.pop()
            misplaced = bool(self.chunks) and on_chunk != (opcode == Opcode.CHUNK)
            misplaced |= opcode == Opcode.DATA_END and size != _DATA_END_BYTES
            if misplaced or end > self.size or (ahead and end > ahead[-1]):
                if not self.chunks:
                    self.warnings.append(
                        f"not closed or cut off: the file ends at byte {self.size}, {self.size - position} bytes "
                        "into a record; what should follow is lost."
                    )
                    return
                lost = _counts(self.chunks[position]) if on_chunk else Counter()
                self.damages.append(_Damage(position, "broken record", lost))
                if not ahead:
                    return
                position = ahead[-1]
                continue
            content = self.stream.read(size)
            if opcode == Opcode.DATA_END:
                if not self.closed:
                    self.warnings.append("the index at the end is cut off; no sample is lost by that.")
                expected = _parse(DataEnd, content).data_section_crc
                if expected == 0:
                    self.unchecked += self.unchunked
                if expected not in (0, checksum) and not self.damages:
                    self.warnings.append("damaged outside its chunks (checksum): metadata may be wrong.")
                return
            checksum = zlib.crc32(content, zlib.crc32(head, checksum))
            yield opcode, position, content
            position = end

    def read_record(self, opcode: int, position: int, content: bytes) -> None:
        """Take in a record other than a chunk or an index."""
        try:
            if opcode == Opcode.MESSAGE:
                if len(content) < MESSAGE_HEAD:
                    raise ValueError(f"a message of {len(content)} bytes")
                self.unchunked += 1
                self.take(struct.unpack_from("<H", content)[0], content)
            elif opcode == Opcode.METADATA:
                record = _parse(Metadata, content)
                self.metadata.setdefault(record.name, {}).update(record.metadata)
            else:
                self.define(opcode, content)
        except _DAMAGE as error:
            self.damages.append(_Damage(position, f"unreadable record: {error}", Counter()))

    def define(self, opcode: int, content: bytes) -> None:
        """Remember a schema or a channel; the first definition stays, and a sound summary is read first."""
        if opcode == Opcode.SCHEMA:
            schema = _parse(Schema, content)
            self.schemas.setdefault(schema.id, schema)
        elif opcode == Opcode.CHANNEL:
            channel = _parse(Channel, content)
            known = self.schemas.get(channel.schema_id, Schema(id=0, data=b"", encoding="", name="unknown"))
            said = tuple(channel.metadata.items())
            info = TopicInfo(channel.topic, known.name, channel.message_encoding, known.encoding, known.data, said)
            if channel.id not in self.channels:
                of_topic = {other for other, known in self.channels.items() if known.topic == channel.topic}
                self.channels[channel.id] = info
                if of_topic:
                    of_topic.add(channel.id)
                    self.shared |= {other: of_topic for other in of_topic}

    def read_chunk(self, position: int, content: bytes) -> _Damage | None:
        """Take the messages of a chunk; return the damage if its loss is still to be counted."""
        try:
            chunk = _parse(Chunk, content)
            self.split_chunk(_decompress(chunk), position)
            self.unchecked += chunk.uncompressed_crc == 0
        except _DAMAGE as error:
            index = self.chunks.get(position)
            damage = _Damage(position, str(error), _counts(index) if index else None)
            self.damages.append(damage)
            return None if index else damage
        for channel, messages in self.pending.items():
            if len(messages) >= _BATCH:
                self.hand_over(channel)
        return None

    def split_chunk(self, data: bytes, position: int) -> None:
        at, end, pending = 0, len(data), self.pending
        while at + _MESSAGE.size <= end:
            opcode, size, channel = _MESSAGE.unpack_from(data, at)
            stop = at + _RECORD.size + size
            if stop > end:
                raise ValueError(f"a record runs past the end of the chunk by {stop - end} bytes")
            if opcode != Opcode.MESSAGE:
                self.read_record(opcode, position, data[at + _RECORD.size : stop])
            elif size < MESSAGE_HEAD:
                raise ValueError(f"a message of {size} bytes")
            elif channel in pending and channel not in self.shared:
                pending[channel].append(data[at + _RECORD.size : stop])
            else:
                self.take(channel, data[at + _RECORD.size : stop])
            at = stop

    def take(self, channel: int, message: bytes) -> None:
        """Keep a message if its topic is in use."""
        info = self.channels.get(channel)
        if info is None:
            self.orphans[channel] += 1
        elif self.uses(info.topic):
            for other in self.shared.get(channel, ()):  # messages of a topic stay in the order of the file
                if other != channel and self.pending.get(other):
                    self.hand_over(other)
            messages = self.pending.setdefault(channel, [])
            messages.append(message)
            if len(messages) >= _BATCH:
                self.hand_over(channel)

    def hand_over(self, channel: int) -> None:
        messages, self.pending[channel] = self.pending[channel], []
        if messages:
            self.receive(self.channels[channel], messages)

    def count_from_index(self, damage: _Damage, content: bytes) -> None:
        try:
            index = _parse(MessageIndex, content)
        except _DAMAGE:
            return
        damage.lost = damage.lost or Counter()
        damage.lost[index.channel_id] += len(index.records)

    def losses(self) -> Iterator[str]:
        """State what was lost: where, and how many samples of each topic in use."""
        if self.unchecked:
            yield f"{self.unchecked} chunks or messages {NO_CHECKSUM}: a flipped bit in them would pass unnoticed."
        for damage in self.damages:
            extent = " with an unknown number of messages" if damage.lost is None else ""
            yield f"damaged at byte {damage.position}{extent}: {damage.reason}."
        lost: Counter[str] = Counter()
        for damage in self.damages:
            for channel, count in (damage.lost or {}).items():
                if channel in self.channels and self.uses(self.channels[channel].topic):
                    lost[self.channels[channel].topic] += count
        for topic, count in lost.items():
            yield f"{topic}: {count} samples lost in damaged parts of the file."
        for channel, count in self.orphans.items():
            yield f"channel {channel}: {count} samples lost, because nothing defines the channel."


def _parse(record: Any, content: bytes) -> Any:
    return record.read(ReadDataStream(BytesIO(content)))


def _counts(index: ChunkIndex) -> Counter[int]:
    """Count the messages of a chunk by channel, from where its message indexes lie."""
    by_offset = sorted((offset, channel) for channel, offset in index.message_index_offsets.items())
    ends = [offset for offset, _ in by_offset[1:]]
    ends.append(index.chunk_start_offset + index.chunk_length + index.message_index_length)
    return Counter(
        {
            channel: (end - offset - _INDEX_HEAD) // _INDEX_ENTRY
            for (offset, channel), end in zip(by_offset, ends, strict=True)
        }
    )


def _decompress(chunk: Chunk) -> bytes:
    """Return the records of a chunk.

    Raises:
        ValueError: unknown compression, wrong length or wrong checksum; or what the decompressor raises.
    """
    data: bytes = chunk.data
    if chunk.uncompressed_size > _LARGEST_CHUNK:
        raise ValueError(f"chunk of {chunk.uncompressed_size} bytes, more than {_LARGEST_CHUNK}")
    if chunk.compression == "zstd":
        declared = zstandard.get_frame_parameters(data).content_size
        if declared not in (chunk.uncompressed_size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError(f"chunk of {declared} bytes, expected {chunk.uncompressed_size}")
        data = zstandard.ZstdDecompressor().decompress(data, max_output_size=chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=chunk.uncompressed_size + 1)
    elif chunk.compression:
        raise ValueError(f"unknown compression '{chunk.compression}'")
    if len(data) != chunk.uncompressed_size:
        raise ValueError(f"chunk of {len(data)} bytes, expected {chunk.uncompressed_size}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise ValueError("wrong checksum")
    return data
