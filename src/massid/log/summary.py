"""What an MCAP file holds, topic by topic, before any role is read from it."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from massid.log.containers import read_messages
from massid.log.files import kind_of
from massid.log.mcap.container import TopicInfo
from massid.log.tables import TABLES, read_table
from massid.log.topics.map import TimeColumn
from massid.typing import IntArray
from massid.walk.conventions import LATEST_NS, NANOSECONDS

_LOG_TIME = struct.Struct("<6xQ")
_GAP_PERIODS = 1.5


@dataclass(frozen=True)
class TopicSummary:
    """One topic by its log times.

    Attributes:
        info: name, message type and encoding.
        messages: how many.
        first_ns: log time of the first message [ns].
        last_ns: log time of the last message [ns].
        rate_hz: one over the median period; 0 for fewer than two messages.
        gaps: periods longer than one and a half of the median.
        longest_gap_s: the longest period [s].
        jumps: log times that are not after the one before.
    """

    info: TopicInfo
    messages: int
    first_ns: int
    last_ns: int
    rate_hz: float
    gaps: int
    longest_gap_s: float
    jumps: int


@dataclass(frozen=True)
class LogSummary:
    """A file.

    Attributes:
        topics: every topic, in the order of the file.
        metadata: metadata records by name.
        warnings: damage and loss, one line each.
    """

    topics: tuple[TopicSummary, ...]
    metadata: Mapping[str, Mapping[str, str]]
    warnings: tuple[str, ...]

    @property
    def duration_s(self) -> float:
        """From the first message of any topic to the last [s]."""
        used = [topic for topic in self.topics if topic.messages]
        if not used:
            return 0.0
        return (max(t.last_ns for t in used) - min(t.first_ns for t in used)) / NANOSECONDS


def summarise_log(path: Path | str, time: TimeColumn | None = None) -> LogSummary:
    """Look through a whole log.

    Args:
        path: see `read_walk`.
        time: of a table, the column of time.

    Raises:
        LogError: there is no such file, or it is no log.
    """
    path = Path(path)
    kind = None if path.is_dir() else kind_of(path)
    if kind in TABLES:
        table = read_table(path, kind)
        return LogSummary((_summarise(table.info, table.times_ns(time)),), {}, ())
    times: dict[str, list[int]] = {}

    def receive(info: TopicInfo, records: list[bytes]) -> None:
        stamps = times.setdefault(info.topic, [])
        stamps += [min(_LOG_TIME.unpack_from(record)[0], LATEST_NS) for record in records]

    contents = read_messages(Path(path), lambda _: True, receive)
    topics, warnings = [], list(contents.warnings)
    for topic, info in contents.topics.items():
        stamps = np.array(times.get(topic, []), np.int64)
        late = int((stamps == LATEST_NS).sum())
        if late:
            warnings.append(f"{topic}: {late} of {len(stamps)} log times are 2^63 ns or more, after the year 2262.")
        topics.append(_summarise(info, stamps))
    return LogSummary(tuple(topics), contents.metadata, tuple(warnings))


def _summarise(info: TopicInfo, stamps: IntArray) -> TopicSummary:
    if not len(stamps):
        return TopicSummary(info, 0, 0, 0, 0.0, 0, 0.0, 0)
    steps = np.diff(stamps)
    forward = steps[steps > 0]
    period = float(np.median(forward)) if len(forward) else 0.0
    return TopicSummary(
        info=info,
        messages=len(stamps),
        first_ns=int(stamps.min()),
        last_ns=int(stamps.max()),
        rate_hz=NANOSECONDS / period if period else 0.0,
        gaps=int((forward > _GAP_PERIODS * period).sum()),
        longest_gap_s=float(forward.max()) / NANOSECONDS if len(forward) else 0.0,
        jumps=int((steps <= 0).sum()),
    )
