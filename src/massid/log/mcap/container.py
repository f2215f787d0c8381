"""Walk through an MCAP file from front to back, check every checksum, keep what is sound of a damaged one.

The index at the end tells where to go on behind what is broken. Where it contradicts the data, the data is believed.
What a chunk inflates to is bounded by what it claims, by `LARGEST_CHUNK`, and together by the size of the file.
"""

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

_MESSAGES, _DEFINITIONS = int(Opcode.MESSAGE), (int(Opcode.SCHEMA), int(Opcode.CHANNEL))  # compared ever so often
_RECORD = struct.Struct("<BQ")  # opcode, length
_NUMBER = struct.Struct("<H")  # of a schema or a channel
_MESSAGE = struct.Struct("<BQH")  # opcode, length, channel
MESSAGE_HEAD = 22
"""Bytes of a message record before the message: channel, sequence, log time and publish time."""
NO_CHECKSUM = "carry no checksum"
LARGEST_CHUNK = 1 << 28
"""Bytes that a chunk may inflate to."""
MOST_INFLATED, MOST_INFLATED_AT_LEAST = 500, 1 << 24
"""What all chunks may inflate to: so many times the size of the file, or so many bytes if that is more."""
_MOST_CHANNELS = 10_000
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, summary start, summary offset start, checksum
_DATA_END_BYTES = 4
_DATA_END = _RECORD.pack(Opcode.DATA_END, _DATA_END_BYTES)
_HEADER = MAGIC + bytes([Opcode.HEADER])
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
    topics: dict[str, TopicInfo] = {}
    metadata: dict[str, dict[str, str]] = {}
    warnings: list[str] = []
    try:
        with path.open("rb") as stream:
            size = path.stat().st_size
            start: int | None = 0
            while start is not None:
                scan = _Scan(stream, start, size, uses, receive)
                scan.run()
                for info in scan.channels.values():
                    topics.setdefault(info.topic, info)
                for name, content in scan.metadata.items():
                    metadata.setdefault(name, {}).update(content)
                warnings += [*scan.warnings, *scan.losses()]
                start = scan.next_log
                if start is not None:
                    warnings.append(f"another log begins at byte {start}: both are read, as one log.")
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror}.") from error
    except _TooMuchError as error:
        raise LogError(f"{path}: {error}.") from error
    return Contents(topics, metadata, tuple(warnings))


class _TooMuchError(Exception):
    """A file that holds more than any log does."""


@dataclass
class _Damage:
    """A part of the file that cannot be used, and the messages in it by channel if an index tells."""

    position: int
    reason: str
    lost: Counter[int] | None = None


class _Scan:
    """One pass over one log: a file from some byte on, to its end or to where another log begins."""

    def __init__(
        self,
        stream: IO[bytes],
        start: int,
        size: int,
        uses: Callable[[str], bool],
        receive: Callable[[TopicInfo, list[bytes]], None],
    ) -> None:
        self.stream = stream
        self.start = start
        self.size = size
        self.next_log: int | None = None
        self.uses = uses
        self.receive = receive
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, TopicInfo] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.warnings: list[str] = []
        self.damages: list[_Damage] = []
        self.closed = False
        self.chunks: dict[int, ChunkIndex] = {}  # by position of the chunk
        self.framed = False  # whether the lengths of all records lead to the end of the data
        self.indexed: dict[tuple[int, int], bytes] = {}  # definitions at the end, by kind and number
        self.inflated = 0
        self.budget = max(MOST_INFLATED_AT_LEAST, MOST_INFLATED * (size - start))
        self.pending: dict[int, list[bytes]] = {}  # messages to hand over, by channel
        self.unused: set[int] = set()  # channels of topics that are not in use
        self.latest: dict[str, int] = {}  # by topic, the channel whose messages are to be handed over
        self.channel_of: dict[str, int] = {}  # the first channel of each topic
        self.shared: set[int] = set()  # channels of topics that have several
        self.orphans: Counter[int] = Counter()  # messages of channels that nothing defines
        self.unchecked = 0  # chunks, and messages outside of chunks, that no checksum protects
        self.unchunked = 0  # messages outside of chunks

    def run(self) -> None:
        index_damage = ""
        try:
            self.read_summary()
        except _DAMAGE as error:
            index_damage = f"the index at the end is damaged ({error}); the data is read without it."
            self.forget_index()
        self.check_index()
        uncounted: _Damage | None = None  # the chunk whose message indexes follow next
        for opcode, position, content in self.records():
            if opcode == Opcode.CHUNK:
                uncounted = self.read_chunk(position, content)
            elif opcode == Opcode.MESSAGE_INDEX:
                if uncounted is not None:
                    self.count_from_index(uncounted, content)
            else:
                uncounted = None
                if self.indexed:
                    self.confirm(opcode, content, sound=False)
                self.read_record(opcode, position, content)
        for channel in self.pending:
            self.hand_over(channel)
        if index_damage and self.next_log is None:  # else it is the other log's
            self.warnings.insert(0, index_damage)

    def forget_index(self) -> None:
        self.chunks.clear()
        self.schemas.clear()
        self.channels.clear()
        self.channel_of.clear()
        self.shared.clear()
        self.indexed.clear()

    def check_index(self) -> None:
        """Compare where the index says that chunks are with where the lengths of the records lead."""
        if not self.chunks:
            return
        position, found, listed = self.start + len(MAGIC), 0, 0
        boundaries: set[int] = set()
        while position <= self.size - _RECORD.size:
            self.stream.seek(position)
            head = self.stream.read(_RECORD.size)
            opcode, size = _RECORD.unpack(head)
            if opcode == Opcode.DATA_END:
                self.framed = size == _DATA_END_BYTES
                break
            if position in self.chunks:
                boundaries.add(position)
            if opcode == Opcode.CHUNK:
                found += 1
                listed += position in self.chunks
            position += _RECORD.size + size
        if not self.framed:
            return  # something is broken, behind which the index may help
        misplaced = len(self.chunks) - len(boundaries)
        if not misplaced and listed == found:
            return
        self.warnings.append(
            f"the index at the end contradicts the data: of its {len(self.chunks)} chunks {misplaced} are not where it "
            f"says, and of the {found} in the data it lists {listed}; the data is read as it stands."
        )
        if listed < found / 2:
            self.forget_index()
        else:
            self.chunks = {position: index for position, index in self.chunks.items() if position in boundaries}

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
        length = self.size - len(tail) - start - self.start
        data_end = self.start + start - len(_DATA_END) - _DATA_END_BYTES
        if opcode != Opcode.FOOTER or length < 0 or data_end < self.start:
            raise ValueError("its position is impossible")
        self.stream.seek(data_end)
        if not self.stream.read(len(_DATA_END) + _DATA_END_BYTES).startswith(_DATA_END):
            raise ValueError("it does not follow the data")
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
                self.chunks[self.start + index.chunk_start_offset] = index
            else:
                self.define(opcode, content)
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self.indexed.setdefault((opcode, _NUMBER.unpack_from(content)[0]), content)

    def records(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield opcode, position and content of each record of the data section.

        A broken length leads astray; the chunk positions that the summary tells bring the walk back.
        """
        position, checksum = self.start + len(MAGIC), zlib.crc32(MAGIC)
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
            misplaced = bool(self.chunks) and on_chunk != (opcode == Opcode.CHUNK) and (on_chunk or not self.framed)
            misplaced |= opcode == Opcode.DATA_END and size != _DATA_END_BYTES
            if misplaced or end > self.size or (ahead and end > ahead[-1]):
                if not self.chunks:
                    self.next_log = self.find_log(position)
                    end = self.size if self.next_log is None else self.next_log
                    self.warnings.append(
                        f"not closed or cut off: the {'file' if self.next_log is None else 'log'} ends at byte {end}, "
                        f"{end - position} bytes into a record; what should follow is lost."
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
                self.next_log = self.find_log(end)
                return
            checksum = zlib.crc32(content, zlib.crc32(head, checksum))
            yield opcode, position, content
            position = end

    def find_log(self, position: int) -> int | None:
        """Where another log begins behind a position, as in files that were pasted together."""
        kept = b""
        self.stream.seek(position)
        while block := self.stream.read(1 << 20):
            at = (kept + block).find(_HEADER)
            if at >= 0:
                return position - len(kept) + at
            position += len(block)
            kept = block[-len(_HEADER) + 1 :]
        return None

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
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        if len(content) >= _NUMBER.size:
            number = _NUMBER.unpack_from(content)[0]
            if number in (self.schemas if opcode == Opcode.SCHEMA else self.channels):
                return
        if opcode == Opcode.SCHEMA:
            schema = _parse(Schema, content)
            self.schemas[schema.id] = schema
            return
        channel = _parse(Channel, content)
        known = self.schemas.get(channel.schema_id, Schema(id=0, data=b"", encoding="", name="unknown"))
        said = tuple(channel.metadata.items())
        info = TopicInfo(channel.topic, known.name, channel.message_encoding, known.encoding, known.data, said)
        self.channels[channel.id] = info
        if len(self.channels) > _MOST_CHANNELS:
            raise _TooMuchError(f"has more than {_MOST_CHANNELS} channels; logs of robots have some hundred at most")
        first = self.channel_of.setdefault(channel.topic, channel.id)
        if first != channel.id:
            self.shared |= {first, channel.id}

    def confirm(self, opcode: int, content: bytes, *, sound: bool) -> None:
        """Compare what the data define with what the index at the end said; a sound chunk is believed."""
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL) or len(content) < _NUMBER.size:
            return
        key = (opcode, _NUMBER.unpack_from(content)[0])
        said = self.indexed.get(key, content)
        if said != content and not sound:
            return
        self.indexed.pop(key, None)
        if said == content:
            return
        self.warnings.append("the index at the end defines topics otherwise than the data; the data is believed.")
        for channel in self.pending:
            self.hand_over(channel)
        self.pending.clear()
        for kind, number in (key, *self.indexed):  # what the data have not confirmed
            if kind == Opcode.SCHEMA:
                self.schemas.pop(number, None)
            else:
                self.channels.pop(number, None)
        self.indexed.clear()
        self.unused.clear()
        self.channel_of = {info.topic: number for number, info in reversed(self.channels.items())}

    def read_chunk(self, position: int, content: bytes) -> _Damage | None:
        """Take the messages of a chunk; return the damage if its loss is still to be counted."""
        try:
            chunk = _parse(Chunk, content)
            self.inflated += chunk.uncompressed_size
            if self.inflated > self.budget:
                raise ValueError(f"it would inflate the file to more than {self.budget} bytes")
            self.split_chunk(_decompress(chunk), position, checked=chunk.uncompressed_crc != 0)
            self.unchecked += chunk.uncompressed_crc == 0
        except _DAMAGE as error:
            index = self.chunks.get(position)
            damage = _Damage(position, str(error), _counts(index) if index else None)
            self.damages.append(damage)
            return None if index else damage
        return None

    def split_chunk(self, data: bytes, position: int, *, checked: bool) -> None:
        at, end, pending, shared, unused = 0, len(data), self.pending, self.shared, self.unused
        while at + _MESSAGE.size <= end:
            opcode, size, channel = _MESSAGE.unpack_from(data, at)
            stop = at + _RECORD.size + size
            if stop > end:
                raise ValueError(f"a record runs past the end of the chunk by {stop - end} bytes")
            if opcode == _MESSAGES:
                if size < MESSAGE_HEAD:
                    raise ValueError(f"a message of {size} bytes")
                if channel in pending and channel not in shared:
                    messages = pending[channel]
                    messages.append(data[at + _RECORD.size : stop])
                    if len(messages) >= _BATCH:
                        self.hand_over(channel)
                elif channel not in unused:
                    self.take(channel, data[at + _RECORD.size : stop])
            elif opcode in _DEFINITIONS:
                content = data[at + _RECORD.size : stop]
                if self.indexed:
                    self.confirm(opcode, content, sound=checked)
                self.read_record(opcode, position, content)
            elif opcode == 0:
                raise ValueError("a record of no kind")
            at = stop

    def take(self, channel: int, message: bytes) -> None:
        """Keep a message if its topic is in use."""
        info = self.channels.get(channel)
        if info is None:
            self.orphans[channel] += 1
        elif channel in self.unused or not self.uses(info.topic):
            self.unused.add(channel)
        else:
            if channel in self.shared:  # messages of a topic stay in the order of the file
                before = self.latest.setdefault(info.topic, self.channel_of.get(info.topic, channel))
                if before != channel and self.pending.get(before):
                    self.hand_over(before)
                self.latest[info.topic] = channel
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
    if chunk.uncompressed_size > LARGEST_CHUNK:
        raise ValueError(f"chunk of {chunk.uncompressed_size} bytes, more than {LARGEST_CHUNK}")
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
