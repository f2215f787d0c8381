"""ROS 2 messages as bytes (CDR): where each field of a message lies, found from the message definition.

All messages of a topic share one byte layout as long as their strings and array lengths stay the same. That
layout is traced once, on one message; thousands of messages are then read or written as one NumPy record array.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_PRIMITIVES: dict[str, str] = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
_FIELD = re.compile(
    r"^(?P<type>[A-Za-z][\w/]*)(?:<=\d+)?(?P<array>\[(?:<=)?\d*\])?\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)$"
)
_HEADER_BYTES = 4  # the encapsulation header: alignment counts from its end
_XCDR2 = range(0x06, 0x0C)
_MAX_TRAILING = 3  # some middleware pads a message to a multiple of four
_MAX_FIELDS = 100_000  # of one message; a damaged definition must not keep the reader busy
_LARGEST_DEFINITION = 1 << 22
_LONGEST_LINE = 10_000
_MOST_DIGITS = 9
_MAX_DEPTH = 32


class CdrError(ValueError):
    """A message or a message definition that cannot be understood; says where."""


@dataclass(frozen=True)
class Field:
    """One field of a message: its type, and how many (None: one, -1: a sequence, else an array of that length)."""

    name: str
    type: str
    count: int | None


@dataclass(frozen=True)
class Schema:
    """A message type with all types that it contains, by name without `/msg/`."""

    root: str
    types: Mapping[str, tuple[Field, ...]]


@dataclass(frozen=True)
class Leaf:
    """A number or an array of numbers in a message: byte offset, NumPy type, and length (None: a scalar)."""

    offset: int
    dtype: str
    count: int | None

    @property
    def format(self) -> str | tuple[str, tuple[int]]:
        """NumPy type of the whole."""
        return self.dtype if self.count is None else (self.dtype, (self.count,))


@dataclass(frozen=True)
class Layout:
    """Where the fields of one kind of message lie.

    Attributes:
        size: bytes of the message, encapsulation header included.
        leaves: numbers by dotted path, such as `pose.pose.position.x`.
        strings: texts by dotted path; a single string is a tuple of one.
        fixed: byte ranges that must not change for the layout to hold: lengths, texts, byte order.
        example: the message from which the layout was traced.
    """

    size: int
    leaves: Mapping[str, Leaf]
    strings: Mapping[str, tuple[str, ...]]
    fixed: tuple[tuple[int, int], ...]
    example: bytes

    def record_dtype(self, paths: Sequence[str]) -> np.dtype[np.void]:
        """Return a NumPy record type with one field per path, over the bytes of one message.

        Raises:
            CdrError: a path is not a number of this message.
        """
        for path in paths:
            if path not in self.leaves:
                raise CdrError(f"no field '{path}'; the fields are: {', '.join(self.leaves)}")
        picked = [self.leaves[path] for path in paths]
        return np.dtype(
            {
                "names": list(paths),
                "formats": [leaf.format for leaf in picked],
                "offsets": [leaf.offset for leaf in picked],
                "itemsize": self.size,
            }
        )

    def holds_for(self, messages: bytes, count: int, head: int = 0) -> bool:
        """Tell whether `count` concatenated messages, with `head` bytes before each, all have this layout."""
        if len(messages) != count * (head + self.size):
            return False
        table = np.frombuffer(messages, dtype=np.uint8).reshape(count, head + self.size)[:, head:]
        example = np.frombuffer(self.example, dtype=np.uint8)
        return all(bool((table[:, a:b] == example[a:b]).all()) for a, b in self.fixed)


_BUILT_IN = {
    "time": (Field("sec", "int32", None), Field("nanosec", "uint32", None)),
    "duration": (Field("sec", "int32", None), Field("nanosec", "int32", None)),
}
"""What ROS 1 has as types of their own; their numbers are named as in ROS 2."""


def parse_schema(message_type: str, text: str, standard: Mapping[str, str] | None = None) -> Schema:
    """Read a `ros2msg` or `ros1msg` schema: the definition of a message followed by those of the messages in it.

    Args:
        message_type: its name.
        text: the schema.
        standard: definitions of messages that a schema may leave out.

    Raises:
        CdrError: a line that is not a field, or a type without a definition.
    """
    root = message_type.replace("/msg/", "/")
    if len(text) > _LARGEST_DEFINITION:
        raise CdrError(f"the definition of {root} has {len(text)} characters, more than {_LARGEST_DEFINITION}")
    raw: dict[str, list[Field]] = {}
    for index, part in enumerate(re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)):
        lines = part.strip().splitlines()
        name = root
        if index > 0:
            header = lines.pop(0) if lines else ""
            if not header.startswith("MSG:"):
                raise CdrError(f"the definition of {root} has '{header}' where 'MSG: package/Type' was expected")
            name = header.removeprefix("MSG:").strip().replace("/msg/", "/")
        raw[name] = list(_parse_fields(name, lines))
    types: dict[str, tuple[Field, ...]] = {}
    known = {*raw, *(standard or {}), *_BUILT_IN}
    pending, waiting = list(raw), set(raw)
    while pending:
        name = pending.pop()
        if name not in raw:
            raw[name] = list(_BUILT_IN.get(name) or _parse_fields(name, (standard or {})[name].splitlines()))
        types[name] = tuple(_resolve(f, name, known) for f in raw[name])
        named = {field.type for field in types[name]} - set(_PRIMITIVES) - {"string"} - waiting
        pending += named
        waiting |= named
    return Schema(root, types)


def _parse_fields(owner: str, lines: Sequence[str]) -> Iterator[Field]:
    for line in lines:
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        match = _FIELD.match(line.strip()) if len(line) <= _LONGEST_LINE else None
        if match is None:
            raise CdrError(f"the definition of {owner} has the line '{line.strip()}', which is not a field")
        if match["rest"].startswith("="):  # a constant takes no bytes
            continue
        count: int | None = None
        if match["array"] is not None:
            inner = match["array"][1:-1]
            if len(inner) > _MOST_DIGITS and inner.isdigit():
                raise CdrError(f"the definition of {owner} has an array of {inner[:_MOST_DIGITS]}... elements")
            count = int(inner) if inner.isdigit() else -1
        yield Field(match["name"], match["type"].replace("/msg/", "/"), count)


def _resolve(field: Field, owner: str, known: Collection[str]) -> Field:
    if field.type in _PRIMITIVES or field.type == "string":
        return field
    package = owner.rpartition("/")[0]
    for name in (field.type, f"{package}/{field.type}", f"std_msgs/{field.type}"):
        if name in known:
            return Field(field.name, name, field.count)
    raise CdrError(f"field '{field.name}' of {owner} has type '{field.type}', which the schema does not define")


def trace(schema: Schema, message: bytes, *, packed: bool = False) -> Layout:
    """Find the layout of a message.

    Args:
        schema: its type.
        message: in plain CDR.
        packed: the message is one of ROS 1: without a header, padding and the ends of texts.

    Raises:
        CdrError: the message is not so encoded, ends too early, or is longer than its definition.
    """
    tracer = _Tracer(schema, message, packed=packed)
    tracer.walk(schema.root, "")
    rest = len(message) - tracer.position
    if rest > (0 if packed else _MAX_TRAILING):
        raise CdrError(f"{rest} bytes remain after the last field of {schema.root}")
    return Layout(len(message), tracer.leaves, tracer.strings, tuple(tracer.fixed), bytes(message))


def _other_encapsulation(message: bytes) -> str:
    if len(message) >= _HEADER_BYTES and message[0] == 0 and message[1] in _XCDR2:
        return " but XCDR2, which some DDS bridges write: record with rosbag2, or set the writer to XCDR1"
    return ""


class _Tracer:
    """One pass over one message, field by field."""

    def __init__(self, schema: Schema, message: bytes, *, packed: bool) -> None:
        if not packed and (len(message) < _HEADER_BYTES or message[0] != 0 or message[1] > 1):
            raise CdrError(
                f"encapsulation header {message[:4].hex(' ')} is not plain CDR (00 00 or 00 01)"
                + _other_encapsulation(message)
            )
        self.order = "<" if packed or message[1] == 1 else ">"
        self.packed = packed
        self.schema = schema
        self.message = message
        self.position = 0 if packed else _HEADER_BYTES
        self.leaves: dict[str, Leaf] = {}
        self.strings: dict[str, tuple[str, ...]] = {}
        self.fixed: list[tuple[int, int]] = [(0, 0 if packed else 2)]
        self.visited = 0

    def walk(self, type_name: str, prefix: str, depth: int = 0) -> None:
        if depth > _MAX_DEPTH:
            raise CdrError(f"the definition of {type_name} holds itself, or more than {_MAX_DEPTH} messages in a row")
        fields = self.schema.types[type_name]
        self.visit()
        if not fields and not self.packed:  # a message without fields takes one byte
            self.take(f"{prefix}(empty)", 1)
        for field in fields:
            path = prefix + field.name
            self.visit()
            count = self.length(path) if field.count == -1 else field.count
            if field.type in _PRIMITIVES:
                self.numbers(path, _PRIMITIVES[field.type], count)
            elif field.type == "string":
                self.strings[path] = tuple(
                    self.string(path) for _ in range(1 if count is None else self.bounded(count))
                )
            elif count is None:
                self.walk(field.type, path + ".", depth + 1)
            else:
                for index in range(count):
                    self.walk(field.type, f"{path}[{index}].", depth + 1)

    def visit(self) -> None:
        self.visited += 1
        if self.visited > _MAX_FIELDS:
            raise CdrError(f"the message has more than {_MAX_FIELDS} fields")

    def numbers(self, path: str, code: str, count: int | None) -> None:
        size = int(code[1:])
        if count != 0:
            self.align(size)
        self.leaves[path] = Leaf(self.position, self.order + code, count)
        self.take(path, size * (1 if count is None else count))

    def length(self, path: str) -> int:
        self.align(4)
        start = self.position
        self.take(path, 4)
        self.fix(start)
        count = int(struct.unpack_from(self.order + "I", self.message, start)[0])
        if count > len(self.message) - self.position:
            raise CdrError(f"field '{path}' claims {count} elements, more than the message holds")
        return count

    def string(self, path: str) -> str:
        size = self.length(path)
        start = self.position
        self.take(path, size)
        self.fix(start)
        return self.message[start : self.position].rstrip(b"\0").decode("utf-8", errors="replace")

    def bounded(self, count: int) -> int:
        if count > len(self.message) - self.position:
            raise CdrError(f"the message of {len(self.message)} bytes cannot hold {count} texts")
        return count

    def align(self, size: int) -> None:
        if not self.packed:
            self.position += -(self.position - _HEADER_BYTES) % size

    def take(self, path: str, size: int) -> None:
        self.position += size
        if self.position > len(self.message):
            raise CdrError(f"the message of {len(self.message)} bytes ends inside field '{path}'")

    def fix(self, start: int) -> None:
        if self.fixed[-1][1] == start:
            start = self.fixed.pop()[0]
        self.fixed.append((start, self.position))


def encode(schema: Schema, values: Mapping[str, Any]) -> bytes:
    """Write one little-endian message; numbers not named are zero, texts and sequences not named are empty.

    Args:
        schema: the message type; sequences of messages are left empty.
        values: texts, lists of texts, numbers or arrays by dotted path.
    """
    out = bytearray(b"\x00\x01\x00\x00")
    _encode_type(out, schema, schema.root, "", values)
    return bytes(out)


def _encode_type(out: bytearray, schema: Schema, type_name: str, prefix: str, values: Mapping[str, Any]) -> None:
    for field in schema.types[type_name]:
        path = prefix + field.name
        if field.type in _PRIMITIVES:
            default = 0 if field.count is None else [0] * max(field.count, 0)
            array = np.asarray(values.get(path, default), dtype="<" + _PRIMITIVES[field.type])
            if field.count == -1:
                _encode_length(out, array.size)
            if array.size:
                _pad(out, array.itemsize)
                out += array.tobytes()
        elif field.type == "string":
            texts = [values.get(path, "")] if field.count is None else list(values.get(path, []))
            if field.count == -1:
                _encode_length(out, len(texts))
            for text in texts:
                data = text.encode() + b"\0"
                _encode_length(out, len(data))
                out += data
        elif field.count is None:
            _encode_type(out, schema, field.type, path + ".", values)
        elif field.count == -1:
            _encode_length(out, 0)
        else:
            for index in range(field.count):
                _encode_type(out, schema, field.type, f"{path}[{index}].", values)


def _encode_length(out: bytearray, count: int) -> None:
    _pad(out, 4)
    out += struct.pack("<I", count)


def _pad(out: bytearray, size: int) -> None:
    out += bytes(-(len(out) - _HEADER_BYTES) % size)
