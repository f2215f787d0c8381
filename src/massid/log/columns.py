"""Gather the messages of one topic into columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from massid.errors import LogError
from massid.log.cdr import CdrError, Layout, Schema, parse_schema, trace
from massid.log.container import TopicInfo
from massid.log.conventions import NANOSECONDS
from massid.typing import FloatArray, IntArray

_STAMP = ("header.stamp.sec", "header.stamp.nanosec")


@dataclass(frozen=True)
class Block:
    """Consecutive messages of one layout.

    Attributes:
        layout: where their fields lie, and their texts.
        stamps_ns: header stamps since the Unix epoch [ns], shape (n,).
        groups: values by group, each of shape (n, width).
    """

    layout: Layout
    stamps_ns: IntArray
    groups: Mapping[str, FloatArray]

    def __len__(self) -> int:
        return len(self.stamps_ns)


@dataclass
class TopicColumns:
    """Decodes the messages of one topic as they come.

    Attributes:
        source: name of the file, for messages.
        info: the topic and its schema.
        groups: the fields to gather, by group.
        blocks: what was decoded so far, in the order of the file.
        count: number of messages received so far.
    """

    source: str
    info: TopicInfo
    groups: Mapping[str, Sequence[str]]
    blocks: list[Block] = field(default_factory=list)
    count: int = 0
    _schema: Schema = field(init=False)
    _layouts: list[Layout] = field(default_factory=list)

    def __post_init__(self) -> None:
        where = f"{self.source}: topic {self.info.topic}"
        if self.info.message_encoding != "cdr":
            raise LogError(f"{where} is encoded as '{self.info.message_encoding}', expected 'cdr'.")
        if self.info.schema_encoding != "ros2msg":
            raise LogError(f"{where} has a schema in '{self.info.schema_encoding}', expected 'ros2msg'.")
        try:
            self._schema = parse_schema(self.info.message_type, self.info.schema_text)
        except CdrError as error:
            raise LogError(f"{where}: {error}.") from error

    @property
    def stamps_ns(self) -> IntArray:
        """Header stamps of all messages [ns], shape (n,)."""
        return np.concatenate([block.stamps_ns for block in self.blocks])

    def group(self, name: str) -> FloatArray:
        """Return the values of a group over all messages, shape (n, width)."""
        return np.concatenate([block.groups[name] for block in self.blocks])

    def receive(self, messages: list[bytes]) -> None:
        """Decode a batch: at once if all messages have one known layout, else one by one.

        Raises:
            LogError: a message cannot be decoded, or lacks a field; names topic and sample.
        """
        joined = b"".join(messages)
        layout = self._layouts[-1] if self._layouts else self._layout_of(messages[0])
        if layout.holds_for(joined, len(messages)):
            self._decode(layout, joined, len(messages))
            return
        for message in messages:
            self._decode(self._layout_of(message), message, 1)

    def _layout_of(self, message: bytes) -> Layout:
        for layout in self._layouts:
            if layout.holds_for(message, 1):
                return layout
        try:
            layout = trace(self._schema, message)
        except CdrError as error:
            raise LogError(f"{self.source}: {self.info.topic}: sample {self.count}: {error}.") from error
        self._layouts.append(layout)
        return layout

    def _decode(self, layout: Layout, messages: bytes, count: int) -> None:
        paths = [path for group in self.groups.values() for path in group]
        try:
            rows = np.frombuffer(messages, dtype=layout.record_dtype([*_STAMP, *paths]))
        except CdrError as error:
            raise LogError(f"{self.source}: topic {self.info.topic} ({self.info.message_type}) has {error}.") from error
        seconds, nanoseconds = (rows[path].astype(np.int64) for path in _STAMP)
        groups = {name: _stack([rows[path] for path in fields]) for name, fields in self.groups.items()}
        self.blocks.append(Block(layout, seconds * NANOSECONDS + nanoseconds, groups))
        self.count += count


def _stack(columns: Sequence[FloatArray]) -> FloatArray:
    """Put scalar columns, shape (n,), side by side; one array column, shape (n, width), stays as it is."""
    if columns[0].ndim == 2:
        return np.concatenate(columns, axis=1, dtype=np.float64)
    return np.stack(columns, axis=1, dtype=np.float64)
