"""Messages to columns of numbers, whatever they are encoded in: CDR by the schema in the file, JSON or protobuf."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import zstandard

from massid.log.mcap.container import MESSAGE_HEAD, TopicInfo
from massid.log.mcap.schemas import DEFINITIONS
from massid.log.messages.cdr import CdrError, Layout, Schema, parse_schema, trace
from massid.log.messages.paths import ElementMissing, PathError, Pick, find_paths
from massid.log.messages.protobuf import ProtobufError, ProtobufMessages
from massid.typing import AnyArray, FloatArray, IntArray
from massid.walk.conventions import LATEST_NS, NANOSECONDS

_STAMPS = tuple(
    (f"{stamp}.{seconds}", f"{stamp}.{nanoseconds}")
    for stamp in ("header.stamp", "stamp", "header.timestamp", "timestamp")
    for seconds, nanoseconds in (("sec", "nanosec"), ("seconds", "nanos"), ("secs", "nsecs"), ("sec", "nsec"))
)
_MAX_DEPTH = 32
_LONGEST_REASON = 400
_LOG_TIME_OFFSET = 6  # in the head of a message record: after channel and sequence
_LOG_TIME = struct.Struct("<Q")
_ZSTD = b"\x28\xb5\x2f\xfd"
_LARGEST_MESSAGE = 1 << 24
_MOST_INFLATED, _MOST_INFLATED_AT_LEAST = 500, 1 << 16
"""What a compressed message may become: so many times its size, or so many bytes if that is more."""
_PACKED = {"cdr": False, "ros1": True}
_TEXT_SCHEMAS = ("ros2msg", "ros1msg")
_NOT_ROS1 = "; the log says 'ros1': if it was converted, convert the ROS 1 bag with `rosbags-convert`"
_LAYOUTS_KEPT = 15  # texts that change in every message must not make the search for a known layout long


class DecodingError(ValueError):
    """Messages of a topic that cannot be decoded at all; says why."""


@dataclass(frozen=True)
class Block:
    """Consecutive messages of one layout.

    Attributes:
        log_ns: when each was recorded [ns], shape (n,).
        header_ns: their header stamps since the Unix epoch [ns], shape (n,); None if they have none.
        columns: values by key, each of shape (n, width).
        texts: the texts that all of them hold, by path.
    """

    log_ns: IntArray
    header_ns: IntArray | None
    columns: Mapping[str, FloatArray]
    texts: Mapping[str, tuple[str, ...]]

    def __len__(self) -> int:
        return len(self.log_ns)


@dataclass(frozen=True)
class Unreadable:
    """A message that cannot be decoded, and why."""

    reason: str


class Decoder(Protocol):
    """Turns message records, each of `MESSAGE_HEAD` bytes and the message, into blocks.

    Attributes:
        notes: what had to be taken for granted, one line each.
    """

    notes: list[str]

    def decode(self, records: Sequence[bytes]) -> Iterator[Block | Unreadable]:
        """Decode messages in order; a message that lacks a wanted field is as unreadable as a damaged one."""


def make_decoder(info: TopicInfo, wanted: Mapping[str, Sequence[str]]) -> Decoder:
    """Choose the decoder for a topic.

    Args:
        info: the topic and its schema.
        wanted: paths by key.

    Raises:
        DecodingError: the encoding or the schema is not understood.
    """
    encoding, schema = info.message_encoding, info.schema_encoding
    try:
        if encoding in _PACKED:
            definition, notes = _definition(info)
            return CdrDecoder(definition, wanted, packed=_PACKED[encoding], notes=notes)
        if encoding == "json":
            return TreeDecoder(JsonMessages(), wanted)
        if encoding == "protobuf" and schema == "protobuf":
            return TreeDecoder(ProtobufMessages(info.message_type, info.schema_data), wanted)
    except (CdrError, ProtobufError) as error:
        raise DecodingError(f"{error}") from error
    raise DecodingError(
        f"is encoded as '{encoding}' with a schema in '{schema}', expected 'cdr' with 'ros2msg', "
        "'ros1' with 'ros1msg', 'json', or 'protobuf' with 'protobuf'"
    )


def _definition(info: TopicInfo) -> tuple[Schema, list[str]]:
    """The definition of a topic's messages: that of the file, or the standard one of its name.

    Raises:
        CdrError: the file has none that is understood, and the message is no standard one.
    """
    name = info.message_type.replace("/msg/", "/")
    standard = DEFINITIONS.get(name)
    if info.schema_encoding in _TEXT_SCHEMAS and info.schema_data.strip():
        try:
            return parse_schema(info.message_type, info.schema_text, DEFINITIONS), []
        except CdrError:
            if standard is None:
                raise
    encoding = info.schema_encoding
    what = f"a definition in '{encoding}'" if info.schema_data.strip() and encoding else "no definition"
    if standard is None:
        raise CdrError(
            f"has {what} of {info.message_type}, and massid knows none: expected its text in 'ros2msg', which rosbag2 "
            "stores when it finds the package's .msg files; or a topic of another, standard type"
        )
    note = f"the file has {what} of {info.message_type} that can be read; the standard one was taken"
    return parse_schema(info.message_type, standard, DEFINITIONS), [note]


def _inflated(records: Sequence[bytes]) -> Sequence[bytes]:
    """Records whose messages were compressed one by one, as rosbag2 does in its compression mode "message".

    Raises:
        ValueError: a message is no such frame, or larger than any message is.
    """
    if not any(record.startswith(_ZSTD, MESSAGE_HEAD) for record in records):
        return records
    out = []
    for record in records:
        if record.startswith(_ZSTD, MESSAGE_HEAD):
            frame = record[MESSAGE_HEAD:]
            try:
                most = min(_LARGEST_MESSAGE, max(_MOST_INFLATED_AT_LEAST, _MOST_INFLATED * len(frame)))
                size = zstandard.get_frame_parameters(frame).content_size
                if size > most and size != zstandard.CONTENTSIZE_UNKNOWN:
                    raise ValueError(f"a compressed message of {size} bytes, more than {most}")
                data = zstandard.ZstdDecompressor().decompress(frame, max_output_size=most)
            except zstandard.ZstdError as error:
                raise ValueError(f"a compressed message is damaged: {error}") from error
            record = record[:MESSAGE_HEAD] + data  # noqa: PLW2901
        out.append(record)
    return out


@dataclass
class CdrDecoder:
    """Decodes CDR: at once if all messages have one known layout, else one by one."""

    schema: Schema
    wanted: Mapping[str, Sequence[str]]
    packed: bool = False
    notes: list[str] = field(default_factory=list)
    _layouts: list[_KnownLayout] = field(default_factory=list)

    def decode(self, records: Sequence[bytes]) -> Iterator[Block | Unreadable]:
        """Decode messages in order; see `Decoder`."""
        try:
            records = _inflated(records)
        except ValueError as error:
            yield from (Unreadable(str(error)) for _ in records)
            return
        joined = b"".join(records)
        known = self._layouts[-1] if self._layouts else None
        if known is None or not known.layout.holds_for(joined, len(records), MESSAGE_HEAD):
            try:
                known = self._layout_of(records[0])
            except (CdrError, PathError):
                known = None
        if known is not None and known.layout.holds_for(joined, len(records), MESSAGE_HEAD):
            yield known.block(joined)
            return
        for record in records:
            try:
                known = self._layout_of(record)
            except ElementMissing:  # others may hold it
                continue
            except (CdrError, PathError) as error:
                hint = _NOT_ROS1 if self.packed and isinstance(error, CdrError) else ""
                yield Unreadable(f"{error}{hint}")
                continue
            yield known.block(record)

    def _layout_of(self, record: bytes) -> _KnownLayout:
        for known in reversed(self._layouts):
            if known.layout.holds_for(record, 1, MESSAGE_HEAD):
                return known
        del self._layouts[:-_LAYOUTS_KEPT]
        layout = trace(self.schema, record[MESSAGE_HEAD:], packed=self.packed)
        self._layouts.append(_KnownLayout.make(layout, self.wanted))
        return self._layouts[-1]


@dataclass(frozen=True)
class _KnownLayout:
    """A layout with the record type of what is wanted from it."""

    layout: Layout
    record: np.dtype[np.void]
    picks: Mapping[str, tuple[Pick, ...]]
    stamp: tuple[str, str] | None

    @classmethod
    def make(cls, layout: Layout, wanted: Mapping[str, Sequence[str]]) -> _KnownLayout:
        counts = {path: leaf.count for path, leaf in layout.leaves.items()}
        picks = {key: find_paths(counts, paths, layout.strings) for key, paths in wanted.items()}
        stamp = _stamp_paths(counts, picks)
        paths = dict.fromkeys(pick.path for group in picks.values() for pick in group)
        paths |= dict.fromkeys(stamp or ())
        record = np.dtype(
            {
                "names": ["log time", *paths],
                "formats": ["<u8", *(layout.leaves[path].format for path in paths)],
                "offsets": [_LOG_TIME_OFFSET, *(MESSAGE_HEAD + layout.leaves[path].offset for path in paths)],
                "itemsize": MESSAGE_HEAD + layout.size,
            }
        )
        return cls(layout, record, picks, stamp)

    def block(self, records: bytes) -> Block:
        rows = np.frombuffer(records, dtype=self.record)
        columns = {key: _stack([_part(rows[p.path], p.part) for p in group]) for key, group in self.picks.items()}
        header = None
        if self.stamp is not None:
            seconds, nanoseconds = (rows[path].astype(np.int64) for path in self.stamp)
            header = seconds * NANOSECONDS + nanoseconds
        return Block(_signed(rows["log time"]), header, columns, self.layout.strings)


class TreeMessages(Protocol):
    """Messages that decode into dictionaries and lists."""

    def parse(self, message: bytes) -> Any:
        """Decode one message.

        Raises:
            ValueError: it is not such a message.
        """


class JsonMessages:
    """JSON messages; a schema is not needed."""

    def parse(self, message: bytes) -> Any:
        """Decode one message."""
        try:
            return json.loads(message)
        except RecursionError as error:
            raise ValueError("nested too deeply") from error


@dataclass
class TreeDecoder:
    """Decodes messages that become dictionaries, one by one, and gathers those of one shape."""

    messages: TreeMessages
    wanted: Mapping[str, Sequence[str]]
    notes: list[str] = field(default_factory=list)
    _picks: dict[Any, dict[str, tuple[Pick, ...]]] = field(default_factory=dict)

    def decode(self, records: Sequence[bytes]) -> Iterator[Block | Unreadable]:
        """Decode messages in order; see `Decoder`."""
        shape: tuple[tuple[str, int | None], ...] | None = None
        texts: dict[str, tuple[str, ...]] = {}
        gathered: list[tuple[int, dict[str, Any]]] = []
        try:
            records = _inflated(records)
        except ValueError as error:
            yield from (Unreadable(str(error)) for _ in records)
            return
        for record in records:
            try:
                numbers, here = _flatten(self.messages.parse(record[MESSAGE_HEAD:]))
                found = tuple((path, _length(value)) for path, value in numbers.items())
                self._resolve(found, here)
            except ElementMissing:  # others may hold it
                continue
            except ValueError as error:
                if gathered and shape is not None:
                    yield self._block(shape, texts, gathered)
                    gathered = []
                yield Unreadable(" ".join(str(error).split())[:_LONGEST_REASON])
                continue
            if gathered and shape is not None and (found != shape or here != texts):
                yield self._block(shape, texts, gathered)
                gathered = []
            shape, texts = found, here
            log_ns = min(_LOG_TIME.unpack_from(record, _LOG_TIME_OFFSET)[0], LATEST_NS)
            gathered.append((log_ns, numbers))
        if gathered and shape is not None:
            yield self._block(shape, texts, gathered)

    def _resolve(
        self, shape: tuple[tuple[str, int | None], ...], texts: Mapping[str, tuple[str, ...]]
    ) -> dict[str, tuple[Pick, ...]]:
        selects = any("=" in path for paths in self.wanted.values() for path in paths)
        key = (shape, tuple(texts.items()) if selects else ())
        if key not in self._picks:
            counts = dict(shape)
            self._picks[key] = {name: find_paths(counts, paths, texts) for name, paths in self.wanted.items()}
        return self._picks[key]

    def _block(
        self,
        shape: tuple[tuple[str, int | None], ...],
        texts: dict[str, tuple[str, ...]],
        gathered: list[tuple[int, dict[str, Any]]],
    ) -> Block:
        counts, picks = dict(shape), self._resolve(shape, texts)
        columns = {}
        for key, group in picks.items():
            parts = [_part(np.array([numbers[p.path] for _, numbers in gathered], float), p.part) for p in group]
            columns[key] = _stack(parts)
        header = None
        stamp = _stamp_paths(counts, picks)
        if stamp is not None:
            header = np.array([_stamp_ns(numbers[stamp[0]], numbers[stamp[1]]) for _, numbers in gathered], np.int64)
        return Block(np.array([log_ns for log_ns, _ in gathered], np.int64), header, columns, texts)


def _flatten(tree: Any) -> tuple[dict[str, Any], dict[str, tuple[str, ...]]]:
    """Name all numbers and texts of a decoded message by dotted path."""
    numbers: dict[str, Any] = {}
    texts: dict[str, tuple[str, ...]] = {}
    pending: list[tuple[str, Any, int]] = [("", tree, 0)]
    while pending:
        path, value, depth = pending.pop()
        if depth > _MAX_DEPTH:
            raise ValueError(f"nested more than {_MAX_DEPTH} levels deep")
        if isinstance(value, dict):
            prefix = f"{path}." if path else ""
            pending += [(f"{prefix}{name}", item, depth + 1) for name, item in reversed(value.items())]
        elif isinstance(value, list):
            if all(isinstance(item, (int, float)) for item in value):
                numbers[path] = [_number(item) for item in value]
            elif all(isinstance(item, str) for item in value):
                texts[path] = tuple(value)
            elif all(item is None or isinstance(item, (int, float)) for item in value):
                numbers[path] = [np.nan if item is None else _number(item) for item in value]
            else:
                pending += [(f"{path}[{k}]", value[k], depth + 1) for k in reversed(range(len(value)))]
        elif isinstance(value, str):
            texts[path] = (value,)
        elif isinstance(value, (int, float)):
            numbers[path] = _number(value)
    return numbers, texts


def _number(value: float) -> float:
    """Keep a number that NumPy can hold; a JSON integer can be of any size."""
    return value if isinstance(value, float) or abs(value) < LATEST_NS else float("inf")


def _length(value: Any) -> int | None:
    return len(value) if isinstance(value, list) else None


def _stamp_ns(seconds: Any, nanoseconds: Any) -> int:
    total = float(seconds) * NANOSECONDS
    if not abs(total) < LATEST_NS / 2 or not abs(float(nanoseconds)) < LATEST_NS / 2:
        return 0
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def _stamp_paths(counts: Mapping[str, int | None], picks: Mapping[str, Sequence[Pick]]) -> tuple[str, str] | None:
    """Where the stamp of a message stands: at its top, or in the element of an array that is wanted from it."""
    elements = {
        pick.path[: pick.path.index("]") + 2] for group in picks.values() for pick in group if "]." in pick.path
    }
    for prefix in ("", *sorted(elements)[:1]):
        for pair in _STAMPS:
            if all(counts.get(prefix + path, 0) is None for path in pair):
                return prefix + pair[0], prefix + pair[1]
    return None


def _signed(stamps: AnyArray) -> IntArray:
    return np.minimum(stamps, np.uint64(LATEST_NS)).astype(np.int64)


def _part(values: AnyArray, part: slice | None) -> AnyArray:
    return values if part is None else values[:, part]


def _stack(columns: Sequence[AnyArray]) -> FloatArray:
    """Put scalar columns, shape (n,), and array columns, shape (n, width), side by side."""
    tables = [column[:, None] if column.ndim == 1 else column for column in columns]
    return np.concatenate(tables, axis=1, dtype=np.float64)


__all__ = ["Block", "DecodingError", "PathError", "Unreadable", "make_decoder"]
