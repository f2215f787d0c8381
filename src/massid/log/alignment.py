"""Bring the streams of a log onto one sequence of stamps, and say what had to be left out.

Streams that share their stamps are matched sample by sample and no number changes. Others are put on the clock of one
of them: see `massid.walk.resampling`.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np

from massid.errors import LogError
from massid.log.topics.map import Rate
from massid.typing import IntArray
from massid.walk import Segment
from massid.walk.conventions import NANOSECONDS

_GAP_PERIODS = 1.5
_RATE_TOLERANCE = 0.05
_LEAST_SHARED = 0.5
_JITTER = 0.05  # of a period: samples farther off an even clock than this are not taken as evenly spaced
_SLOW_S = 0.005
_ON_CLOCK, _PHASE = 0.95, 1e-4  # this share of the stamps must be this close to an even clock, in periods


@dataclass(frozen=True)
class Stream:
    """Samples with a clock of their own.

    Attributes:
        stamps_ns: in the order of the file [ns], shape (n,).
        held: each value acts until the next sample, as torques and forces do.
    """

    stamps_ns: IntArray
    held: bool


@dataclass(frozen=True)
class Alignment:
    """The samples that all streams share, or the clock onto which they are to be resampled.

    Attributes:
        stamps_ns: common stamps, strictly increasing [ns], shape (n,).
        rows: by stream, which of its samples belong to these stamps, shape (n,); if resampled, those to resample from.
        times_ns: by stream, the stamps of `rows` [ns].
        period_ns: sample period [ns].
        segments: runs without a gap or a jump of the clock.
        resampled: whether the streams must be resampled.
        warnings: what was left out, one line each.
    """

    stamps_ns: IntArray
    rows: Mapping[str, IntArray]
    times_ns: Mapping[str, IntArray]
    period_ns: int
    segments: tuple[Segment, ...]
    resampled: bool
    warnings: tuple[str, ...]


def align(streams: Mapping[str, Stream], source: str, rate: Rate = Rate.SLOWEST, even: bool = False) -> Alignment:
    """Match the samples of several streams by their stamps.

    Args:
        streams: by name; the first is the reference when rates are equal.
        source: name of the file, for messages.
        rate: which stream's rate the walk gets if they differ.
        even: the stamps were taken when samples arrived; jitter in them is not of the samples, which are evenly spaced.

    Raises:
        LogError: a stream has fewer than two samples, or no time has a sample of every stream around it.
    """
    warnings: list[str] = []
    rows: dict[str, IntArray] = {}
    times: dict[str, IntArray] = {}
    breaks: dict[str, IntArray] = {}
    for name, stream in streams.items():
        kept, jumps, lines = _put_in_order(stream.stamps_ns)
        warnings += [f"{name}: {line}." for line in lines]
        rows[name], times[name], breaks[name] = kept, stream.stamps_ns[kept], stream.stamps_ns[jumps]
        if len(kept) < 2:
            why = f" ({'; '.join(lines)})" if lines else ""
            hint = " If its header stamps are not set, use `clock: log` in a topic map." if lines else ""
            raise LogError(f"{source}: {name} holds {len(kept)} usable samples, expected at least 2{why}.{hint}")
    why_not = _why_not_shared(times)
    if why_not is None:
        common = reduce(lambda a, b: np.intersect1d(a, b, assume_unique=True), times.values())
        jittery = _jitter(common) > _JITTER
        if not jittery or even:
            return _shared(common, rows, times, breaks, warnings)
        why_not = f"stamps are up to {_jitter(common):.0%} of a period off an even clock"
    return _on_one_clock(streams, rows, times, breaks, warnings, why_not, source, rate, even)


def _shared(
    common: IntArray,
    rows: Mapping[str, IntArray],
    times: Mapping[str, IntArray],
    breaks: Mapping[str, IntArray],
    warnings: list[str],
) -> Alignment:
    """Keep the samples at shared stamps as they are."""
    warnings = [*warnings, *_missing(times, common)]
    matched = {name: rows[name][np.searchsorted(stamps, common)] for name, stamps in times.items()}
    period, cuts = _period(common), _gaps(common)
    if len(cuts):
        length_s = (common[cuts[0]] - common[cuts[0] - 1]) / NANOSECONDS
        warnings.append(
            f"{len(cuts)} gap{'s' * (len(cuts) > 1)} longer than {_GAP_PERIODS} sample periods, the first of "
            f"{length_s:.4f} s after sample {cuts[0] - 1}."
        )
    jitter = _jitter(common)
    if jitter > _JITTER:
        warnings.append(f"log times are up to {jitter:.0%} of a period off an even clock; taken as evenly spaced.")
    places = set(cuts.tolist())
    for stamps in breaks.values():
        places |= set(np.searchsorted(common, stamps).tolist())
    edges = [0, *sorted(places - {0, len(common)}), len(common)]
    segments = tuple(Segment(start, stop) for start, stop in pairwise(edges))
    return Alignment(common, matched, dict.fromkeys(rows, common), period, segments, False, tuple(warnings))


def _on_one_clock(
    streams: Mapping[str, Stream],
    rows: Mapping[str, IntArray],
    times: dict[str, IntArray],
    breaks: Mapping[str, IntArray],
    warnings: list[str],
    why: str,
    source: str,
    rate: Rate,
    even: bool,
) -> Alignment:
    """Find the stretches that every stream covers, and an even clock for each."""
    periods = {name: _period(stamps) for name, stamps in times.items()}
    choose = max if rate is Rate.SLOWEST else min
    leader = choose(periods, key=lambda name: periods[name])
    if periods[leader] == periods[next(iter(periods))]:
        leader = next(iter(periods))
    runs: dict[str, list[tuple[int, int]]] = {}
    for name, stamps in list(times.items()):
        cuts = sorted({*_gaps(stamps).tolist(), *np.searchsorted(stamps, breaks[name]).tolist()} - {0, len(stamps)})
        edges = [0, *cuts, len(stamps)]
        if even:
            times[name] = _evened(stamps, edges)
        extra = periods[name] if streams[name].held else 0
        runs[name] = [(int(times[name][a]), int(times[name][b - 1]) + extra) for a, b in pairwise(edges)]
    shared = reduce(_intersect, runs.values())
    period = _mean_period(times[leader])
    grids = []
    for start, stop in shared:
        inside = times[leader][(times[leader] >= start) & (times[leader] <= stop)]
        first = int(inside[0]) if len(inside) else start
        count = int((stop - first) / period) + 1
        held_until = stop - min((periods[n] for n, s in streams.items() if s.held), default=0)
        grid = first + np.rint(np.arange(max(count, 0)) * period).astype(np.int64)
        grid = grid[grid <= max(held_until, first)]
        if len(grid) >= 3:
            grids.append(grid)
    if not grids:
        listed = ", ".join(
            f"{name} {len(stamps)} from {stamps[0]} to {stamps[-1]} ns" for name, stamps in times.items()
        )
        raise LogError(f"{source}: no stretch of time is covered by all streams (samples: {listed}).")
    lines = [
        f"{why}: resampled to the clock of {leader} ({NANOSECONDS / period:.6g} Hz); positions by cubic interpolation "
        "with the velocities as slopes, velocities linearly, torques and wrenches averaged over each period."
    ]
    if period > _SLOW_S * NANOSECONDS:
        lines.append(f"a clock of {NANOSECONDS / period:.4g} Hz is slow for identification; 500 Hz or more is better.")
    if len(grids) > 1:
        split = len(grids) - 1
        lines.append(f"{split} gaps split the log." if split > 1 else "1 gap splits the log.")
    edges = np.cumsum([0, *(len(grid) for grid in grids)]).tolist()
    segments = tuple(Segment(start, stop) for start, stop in pairwise(edges))
    stamps = np.concatenate(grids)
    return Alignment(stamps, rows, times, round(period), segments, True, (*warnings, *lines))


def _intersect(left: list[tuple[int, int]], right: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Stretches that two lists of stretches have in common."""
    found, i, j = [], 0, 0
    while i < len(left) and j < len(right):
        start, stop = max(left[i][0], right[j][0]), min(left[i][1], right[j][1])
        if start < stop:
            found.append((start, stop))
        if left[i][1] < right[j][1]:
            i += 1
        else:
            j += 1
    return found


def _evened(stamps: IntArray, edges: list[int]) -> IntArray:
    """Put the samples of each run on the straight line through their stamps."""
    out = stamps.copy()
    for start, stop in pairwise(edges):
        if stop - start > 2:
            relative = (stamps[start:stop] - stamps[start]).astype(np.float64)
            slope, offset = np.polyfit(np.arange(stop - start), relative, 1)
            out[start:stop] = stamps[start] + np.rint(offset + slope * np.arange(stop - start)).astype(np.int64)
    return out


def _period(stamps: IntArray) -> int:
    """Median sample period [ns]."""
    steps = np.sort(np.diff(stamps))
    return int(steps[(len(steps) - 1) // 2])


def _mean_period(stamps: IntArray) -> float:
    """Mean sample period, gaps left out [ns]."""
    steps = np.diff(stamps)
    return float(steps[steps < _GAP_PERIODS * _period(stamps)].mean())


def _gaps(stamps: IntArray) -> IntArray:
    """Samples before which there is a gap."""
    return np.flatnonzero(np.diff(stamps) > _GAP_PERIODS * _period(stamps)) + 1


def _jitter(stamps: IntArray) -> float:
    """How far steps are off the median period, as a share of it: the 99th percentile, gaps left out."""
    period, steps = _period(stamps), np.diff(stamps)
    steps = steps[steps < _GAP_PERIODS * period]
    return float(np.quantile(np.abs(steps - period), 0.99)) / period if len(steps) else 0.0


def _is_one_clock(times: Iterable[IntArray], common: IntArray) -> bool:
    """Whether nearly all stamps lie whole periods from a common one."""
    for stamps in times:
        period = _period(stamps)
        phase = (stamps - common[0] + period // 2) % period - period // 2
        if np.quantile(np.abs(phase), _ON_CLOCK) > _PHASE * period:
            return False
    return True


def _why_not_shared(times: Mapping[str, IntArray]) -> str | None:
    """Say why streams cannot be matched sample by sample; None if they can."""
    periods = {name: float(np.median(np.diff(stamps))) for name, stamps in times.items()}
    if max(periods.values()) > (1.0 + _RATE_TOLERANCE) * min(periods.values()):
        listed = ", ".join(f"{name} {NANOSECONDS / period:.6g} Hz" for name, period in periods.items())
        return f"the topics have different rates ({listed})"
    first, *others = times.values()
    if all(np.array_equal(first, other) for other in others):
        return None
    common = reduce(lambda a, b: np.intersect1d(a, b, assume_unique=True), times.values())
    if len(common) >= 2 and _is_one_clock(times.values(), common):  # samples are missing, but the clock is one
        return None
    if len(common) < max(2, _LEAST_SHARED * min(len(stamps) for stamps in times.values())):
        listed = ", ".join(f"{name} {len(stamps)}" for name, stamps in times.items())
        return f"only {len(common)} stamps are shared by all streams (samples: {listed})"
    return None


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
