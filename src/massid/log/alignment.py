"""Bring the topics of a log onto one sequence of stamps, and say what had to be left out."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np

from massid.errors import LogError
from massid.log.conventions import NANOSECONDS
from massid.log.walk import Segment
from massid.typing import IntArray

_GAP_PERIODS = 1.5
_RATE_TOLERANCE = 0.05
_LEAST_SHARED = 0.5


@dataclass(frozen=True)
class Alignment:
    """The samples that all topics share.

    Attributes:
        stamps_ns: common stamps, strictly increasing [ns], shape (n,).
        rows: by topic, which of its messages belong to these stamps, shape (n,).
        period_ns: median sample period [ns].
        segments: runs without a gap or a jump of the clock.
        warnings: what was left out, one line each.
    """

    stamps_ns: IntArray
    rows: Mapping[str, IntArray]
    period_ns: int
    segments: tuple[Segment, ...]
    warnings: tuple[str, ...]


def align(stamps: Mapping[str, IntArray], source: str) -> Alignment:
    """Match the messages of several topics by their stamps.

    Args:
        stamps: by topic, the stamps of its messages in the order of the file [ns].
        source: name of the file, for messages.

    Raises:
        LogError: a topic has fewer than two samples, the rates differ, or hardly any stamp is shared.
    """
    warnings: list[str] = []
    kept: dict[str, IntArray] = {}
    breaks: list[IntArray] = []
    for topic, times in stamps.items():
        rows, jumps, lines = _put_in_order(times)
        warnings += [f"{topic}: {line}." for line in lines]
        kept[topic] = rows
        breaks.append(times[jumps])
        if len(rows) < 2:
            why = f" ({'; '.join(lines)})" if lines else ""
            raise LogError(f"{source}: {topic} holds {len(rows)} usable samples, expected at least 2{why}.")
    ordered = {topic: stamps[topic][rows] for topic, rows in kept.items()}
    _check_rates(ordered, source)
    common = _shared_stamps(ordered, source)
    warnings += _missing(ordered, common)
    matched = {topic: kept[topic][np.searchsorted(times, common)] for topic, times in ordered.items()}
    steps = np.diff(common)
    period = int(np.sort(steps)[(len(steps) - 1) // 2])
    is_gap = steps > _GAP_PERIODS * period
    if is_gap.any():
        first = int(np.argmax(is_gap))
        warnings.append(
            f"{int(is_gap.sum())} gaps longer than {_GAP_PERIODS} sample periods, the first of "
            f"{steps[first] / NANOSECONDS:.4f} s after sample {first}."
        )
    cuts = set((np.flatnonzero(is_gap) + 1).tolist())
    for jumps in breaks:
        cuts |= set(np.searchsorted(common, jumps).tolist())
    edges = [0, *sorted(cuts - {0, len(common)}), len(common)]
    segments = tuple(Segment(start, stop) for start, stop in pairwise(edges))
    return Alignment(common, matched, period, segments, tuple(warnings))


def _missing(stamps: Mapping[str, IntArray], common: IntArray) -> list[str]:
    """State for each topic how many stamps of the others it lacks."""
    if all(len(times) == len(common) for times in stamps.values()):
        return []
    union = reduce(np.union1d, stamps.values())
    lines = []
    for topic, times in stamps.items():
        lacking = np.setdiff1d(union, times, assume_unique=True)
        if len(lacking):
            after_s = (lacking[0] - union[0]) / NANOSECONDS
            lines.append(
                f"{topic}: no sample for {len(lacking)} of {len(union)} stamps, the first {after_s:.4f} s after "
                "the start; these stamps are left out."
            )
    return lines


def _put_in_order(stamps: IntArray) -> tuple[IntArray, IntArray, list[str]]:
    """Find the longest strictly increasing part of the stamps.

    Returns:
        The rows kept; those kept rows before which the clock jumped; a line for each kind of loss.
    """
    rows = np.arange(len(stamps))
    steps = np.diff(stamps)
    if (steps > 0).all():
        return rows, rows[:0], []
    lines = []
    first_of_each = np.concatenate([[True], steps != 0])
    repeated = int((~first_of_each).sum())
    rows = rows[first_of_each]
    if repeated:
        at = int(np.argmin(first_of_each))
        lines.append(f"{repeated} samples repeat the stamp before them, first sample {at}; left out")
    backward = np.flatnonzero(np.diff(stamps[rows]) <= 0)
    if not len(backward):
        return rows, rows[:0], lines
    longest = _longest_increasing(stamps[rows])
    jumps = longest[1:][np.diff(longest) > 1]
    at = rows[backward[0] + 1]
    back = (stamps[rows[backward[0]]] - stamps[at]) / NANOSECONDS
    lines.append(
        f"stamps jump back {len(backward)} times, first by {back:.4f} s at sample {at}; "
        f"{len(rows) - len(longest)} samples that do not fit a forward clock are left out"
    )
    return rows[longest], rows[jumps], lines


def _longest_increasing(values: IntArray) -> IntArray:
    """Return the positions of a longest strictly increasing subsequence (patience sorting)."""
    ends: list[int] = []  # smallest last value of an increasing run of each length, and where it stands
    places: list[int] = []
    before = np.full(len(values), -1)
    for place, value in enumerate(values.tolist()):
        length = bisect_left(ends, value)
        before[place] = places[length - 1] if length else -1
        ends[length : length + 1] = [value]
        places[length : length + 1] = [place]
    chain = [places[-1]]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.array(chain[::-1], dtype=np.int64)


def _check_rates(stamps: Mapping[str, IntArray], source: str) -> None:
    periods = {topic: float(np.median(np.diff(times))) for topic, times in stamps.items()}
    if max(periods.values()) > (1.0 + _RATE_TOLERANCE) * min(periods.values()):
        listed = ", ".join(f"{topic} {NANOSECONDS / period:.6g} Hz" for topic, period in periods.items())
        raise LogError(f"{source}: the topics have different rates ({listed}), expected one common rate.")


def _shared_stamps(stamps: Mapping[str, IntArray], source: str) -> IntArray:
    first, *others = stamps.values()
    if all(np.array_equal(first, other) for other in others):
        return first
    common = reduce(lambda a, b: np.intersect1d(a, b, assume_unique=True), stamps.values())
    if len(common) < max(2, _LEAST_SHARED * min(len(times) for times in stamps.values())):
        listed = ", ".join(f"{topic} {len(times)}" for topic, times in stamps.items())
        raise LogError(
            f"{source}: only {len(common)} stamps are shared by all topics (samples: {listed}), "
            "expected one common stamp per sample."
        )
    return common
