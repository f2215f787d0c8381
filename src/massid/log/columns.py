"""Gather the messages of one topic into columns, and keep account of the rows that cannot be used."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from massid.errors import LogError
from massid.log.mcap.container import TopicInfo
from massid.log.messages.decoding import Block, Decoder, DecodingError, Unreadable, make_decoder
from massid.typing import BoolArray, FloatArray, IntArray

_AFTER_SEQUENCE = 6  # in a message record, after its channel and number: times and message


@dataclass
class TopicColumns:
    """Decodes the messages of one topic as they come, whatever channels they come on.

    Attributes:
        source: name of the file, for messages.
        info: the topic and its schema; of the first channel if it has several.
        wanted: the fields to gather, by key.
        name: the topic, and which of its messages these are if they are not all.
        blocks: what was decoded so far, in the order of the file.
        unreadable: messages that could not be decoded.
        twice: messages that stood in the log before.
        unusable: why rows must be left out, with their number, in the order found.
    """

    source: str
    info: TopicInfo
    wanted: Mapping[str, Sequence[str]]
    name: str = ""
    blocks: list[Block] = field(default_factory=list)
    unreadable: int = 0
    twice: int = 0
    unusable: list[str] = field(default_factory=list)
    _first_unreadable: str = ""
    _bad: BoolArray | None = None
    _decoders: dict[TopicInfo, Decoder] = field(default_factory=dict)
    _notes: list[str] = field(default_factory=list)
    _seen: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.name = self.name or self.info.topic

    @property
    def where(self) -> str:
        """File and topic, for messages."""
        return f"{self.source}: {self.name}"

    def __len__(self) -> int:
        return sum(len(block) for block in self.blocks)

    def receive(self, info: TopicInfo, records: list[bytes]) -> None:
        """Decode a batch of message records of one of the topic's channels."""
        if info not in self._decoders:
            try:
                self._decoders[info] = make_decoder(info, self.wanted)
            except DecodingError as error:
                raise LogError(f"{self.where}: {error}.") from error
            self._notes += self._decoders[info].notes
        records = self._once(records)
        for item in self._decoders[info].decode(records) if records else ():
            if isinstance(item, Unreadable):
                self.unreadable += 1
                self._first_unreadable = self._first_unreadable or f"sample {len(self)}: {item.reason}"
            else:
                self.blocks.append(item)

    def _once(self, records: list[bytes]) -> list[bytes]:
        """The records that did not come before, bit by bit at the same time, as where recordings overlap."""
        keys = [hash(record[_AFTER_SEQUENCE:]) for record in records]
        if len(set(keys)) == len(keys) and self._seen.isdisjoint(keys):
            self._seen.update(keys)
            return records
        new = []
        for key, record in zip(keys, records, strict=True):
            if key not in self._seen:
                self._seen.add(key)
                new.append(record)
        self.twice += len(records) - len(new)
        return new

    def parts(self, path: str) -> dict[tuple[str, ...], TopicColumns]:
        """The messages by the texts that they hold at a path, each kind with columns of its own; of one kind, itself.

        Call it before anything is taken out or marked.
        """
        kinds = list(self.texts(path))
        if len(kinds) <= 1:
            return dict.fromkeys(kinds, self)
        return {kind: self.part([kind], path, kind[0] if kind else "") for kind in kinds}

    def part(self, kinds: Collection[tuple[str, ...]], path: str, name: str) -> TopicColumns:
        """The messages that hold one of these texts at a path, as columns of their own."""
        blocks = [block for block in self.blocks if block.texts.get(path, ()) in kinds]
        return TopicColumns(self.source, self.info, self.wanted, f"{self.name} ({name})", blocks)

    def check(self) -> None:
        """Pass if any message could be decoded.

        Raises:
            LogError: none could; says why the first one could not.
        """
        if self.unreadable and not self.blocks:
            raise LogError(f"{self.where} ({self.info.message_type}): {self._first_unreadable}.")

    def header_ns(self) -> IntArray | None:
        """Header stamps of all messages [ns], shape (n,); None if any message has none."""
        stamps = [block.header_ns for block in self.blocks if block.header_ns is not None]
        return np.concatenate(stamps) if stamps and len(stamps) == len(self.blocks) else None

    def log_ns(self) -> IntArray:
        """Log times of all messages [ns], shape (n,)."""
        return np.concatenate([block.log_ns for block in self.blocks])

    def texts(self, path: str) -> Counter[tuple[str, ...]]:
        """Count the messages by the texts that they hold at a path."""
        counted: Counter[tuple[str, ...]] = Counter()
        for block in self.blocks:
            counted[block.texts.get(path, ())] += len(block)
        return counted

    def widths(self, key: str) -> Counter[int]:
        """Count the messages by how many values they hold for a key."""
        counted: Counter[int] = Counter()
        for block in self.blocks:
            counted[block.columns[key].shape[1]] += len(block)
        return counted

    def values(self, key: str, width: int, order: Sequence[Sequence[int] | None] | None = None) -> FloatArray:
        """Return the values of a key over all messages and forget them, shape (n, width).

        Messages with another number of values give rows of NaN.

        Args:
            key: of `wanted`.
            width: how many values a message should hold.
            order: for each block, which of its columns to take in which order (None: all as they are).
        """
        out = np.full((len(self), width), np.nan)
        at = 0
        for k, block in enumerate(self.blocks):
            values = block.columns.pop(key)  # type: ignore[attr-defined]
            picked = None if order is None else order[k]
            if picked is not None and (not picked or max(picked) < values.shape[1]):
                values = values[:, picked]
            if values.shape[1] == width:
                out[at : at + len(block)] = values
            at += len(block)
        return out

    def leave_out(self, bad: BoolArray, reason: str) -> None:
        """Mark rows as unusable.

        Args:
            bad: which rows, shape (n,).
            reason: what is wrong with the first of them.

        Raises:
            LogError: hardly any row is left.
        """
        if not bad.any():
            return
        self._bad = bad.copy() if self._bad is None else self._bad | bad
        count, n = int(bad.sum()), len(self)
        if n - int(self._bad.sum()) < 2:
            raise LogError(f"{self.where}: {reason} ({count} of {n} samples are like that).")
        self.unusable.append(f"{self.name}: {reason}; {count} of {n} samples are like that and left out.")

    def bridge(self, holes: BoolArray, reason: str) -> None:
        """Say that single values of rows are interpolated.

        Args:
            holes: which rows, shape (n,).
            reason: what is wrong with the first of them.
        """
        count = int(holes.sum())
        self.unusable.append(
            f"{self.name}: {reason}; {count} of {len(self)} samples are like that, one by one; bridged by "
            "interpolation."
        )

    @property
    def left_out(self) -> BoolArray:
        """Rows marked as unusable so far, shape (n,)."""
        return np.zeros(len(self), dtype=bool) if self._bad is None else self._bad

    def usable(self) -> IntArray:
        """Rows that can be used, in the order of the file."""
        rows = np.arange(len(self))
        return rows if self._bad is None else rows[~self._bad]

    def warnings(self) -> list[str]:
        """What was lost on this topic, one line each."""
        lines = [f"{self.info.topic}: {note}." for note in self._notes] + self.unusable
        if self.twice:
            lines.append(f"{self.info.topic}: {self.twice} messages stand in the log twice; each was taken once.")
        if self.unreadable:
            lines.append(
                f"{self.info.topic}: {self.unreadable} messages cannot be decoded and are left out; the first, "
                f"{self._first_unreadable}."
            )
        return lines
