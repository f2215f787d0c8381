"""Bring the streams of a log onto one sequence of stamps, and say what had to be left out.

Streams that share their stamps are matched sample by sample and no number changes. Others are put on the clock of one
of them: see `massid.walk.resampling`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise

import numpy as np

from massid.errors import LogError
from massid.log.clocks import Settled, Stream
from massid.log.cycles import match_cycles
from massid.log.topics.map import Rate
from massid.typing import BoolArray, IntArray
from massid.walk import Segment
from massid.walk.conventions import NANOSECONDS

_GAP_PERIODS = 1.5
_RATE_TOLERANCE = 0.05
_LEAST_SHARED = 0.5
_JITTER = 0.05  # of a period: samples farther off an even clock than this are not taken as evenly spaced
_SLOW_S = 0.005
_FASTER = 0.75  # of a period: streams that come more often are averaged
_ON_CLOCK, _PHASE = 0.95, 1e-4  # this share of the stamps must be this close to an even clock, in periods
MOST_BRIDGED = 3
"""Lost samples in a row that are interpolated."""
_LONGEST_BRIDGE_S, _SLOWEST_BRIDGE_S = 0.025, 0.02  # time between its ends; period at which one sample is still bridged
_MOST_LOST = 0.1  # share of a stream: beyond it, samples are not lost one by one


@dataclass(frozen=True)
class Alignment:
    """The samples that all streams share, or the clock onto which they are to be resampled.

    Attributes:
        stamps_ns: common stamps, strictly increasing [ns], shape (n,).
        rows: by stream, which of its samples belong to these stamps, shape (n,); if resampled or bridged, those to
            interpolate from.
        times_ns: by stream, the stamps of `rows` [ns].
        period_ns: sample period [ns].
        segments: runs without a gap or a jump of the clock.
        resampled: whether the streams must be resampled.
        bridged: whether some streams lack a sample here and there, which is interpolated.
        averaged: whether states that come more often are averaged before they are resampled.
        warnings: what was left out, one line each.
    """

    stamps_ns: IntArray
    rows: Mapping[str, IntArray]
    times_ns: Mapping[str, IntArray]
    period_ns: int
    segments: tuple[Segment, ...]
    resampled: bool
    bridged: bool
    averaged: bool
    warnings: tuple[str, ...]

    @property
    def exact(self) -> bool:
        """Whether every sample of every stream in use is taken as it is."""
        return not self.resampled and not self.bridged


def align(
    settled: Settled,
    source: str,
    lead: str,
    rate: Rate = Rate.AUTO,
    *,
    followers: Collection[str] = (),
    even: bool = False,
    noisy: bool = False,
) -> Alignment:
    """Match the samples of several streams by their stamps.

    Args:
        settled: streams on one clock; the first is the reference when rates are equal.
        source: name of the file, for messages.
        lead: the stream whose rate `Rate.AUTO` takes if there is no noise.
        rate: which stream's rate the walk gets if they differ.
        followers: streams whose rate `Rate.AUTO` never takes.
        even: the stamps were taken when samples arrived; jitter in them is not of the samples, which are evenly spaced.
        noisy: the states have sensor noise, which must stay white and of one level: `Rate.AUTO` takes the slowest
            rate, for what is put between samples is smooth, and averages states that come more often.

    Raises:
        LogError: no time has a sample of every stream around it.
    """
    streams, breaks = settled.streams, settled.breaks_ns
    times: Mapping[str, IntArray] = {name: stream.stamps_ns for name, stream in streams.items()}
    why_not = _why_not_shared(times)
    lines: list[str] = []
    if why_not is not None and (cycles := match_cycles(times)) is not None:
        times, lines, why_not = cycles.times_ns, [cycles.line], _why_not_shared(cycles.times_ns)
        breaks = cycles.on_grid(breaks)
    if why_not is None:
        common = reduce(lambda a, b: np.intersect1d(a, b, assume_unique=True), times.values())
        jittery = _jitter(common) > _JITTER
        if not jittery or even:
            return _shared(common, times, breaks, lines)
        why_not = f"stamps are up to {_jitter(common):.0%} of a period off an even clock"
    periods = {name: _period(stamps) for name, stamps in times.items()}
    slowest = max(periods, key=lambda name: periods[name])
    leader = {
        Rate.AUTO: max(periods.keys() - set(followers), key=lambda name: periods[name]) if noisy else lead,
        Rate.SLOWEST: slowest,
        Rate.FASTEST: min(periods, key=lambda name: periods[name]),
    }[rate]
    if periods[leader] == periods[next(iter(periods))]:
        leader = next(iter(periods))
    return _on_one_clock(
        streams, times, breaks, lines, why_not, source, leader, even=even, averaged=noisy and rate is Rate.AUTO
    )


def _shared(common: IntArray, times: Mapping[str, IntArray], breaks: IntArray, warnings: list[str]) -> Alignment:
    """Keep the samples at shared stamps as they are, and bridge what single streams lack here and there."""
    period = _period(common)
    grid, lines = common, list[str]()
    if any(len(stamps) != len(common) for stamps in times.values()) or len(_gaps(common)):
        grid, lines = _bridged(common, times, breaks, period)
    lacking = {name: np.setdiff1d(grid, stamps, assume_unique=True) for name, stamps in times.items()}
    bridged = any(len(lost) for lost in lacking.values())
    rows, at = {}, {}
    for name, stamps in times.items():
        rows[name] = np.arange(len(stamps)) if len(lacking[name]) else np.searchsorted(stamps, grid)
        at[name] = stamps[rows[name]]
    warnings = [*warnings, *lines, *_missing(times, grid, lacking)]
    cuts = _gaps(grid)
    if len(cuts):
        length_s = (grid[cuts[0]] - grid[cuts[0] - 1]) / NANOSECONDS
        warnings.append(
            f"{len(cuts)} gap{'s' * (len(cuts) > 1)} longer than {_GAP_PERIODS} sample periods, the first of "
            f"{length_s:.4f} s after sample {cuts[0] - 1}."
        )
    jitter = _jitter(grid)
    if jitter > _JITTER:
        warnings.append(f"log times are up to {jitter:.0%} of a period off an even clock; taken as evenly spaced.")
    places = {*cuts.tolist(), *np.searchsorted(grid, breaks).tolist()}
    edges = [0, *sorted(places - {0, len(grid)}), len(grid)]
    segments = tuple(Segment(start, stop) for start, stop in pairwise(edges))
    return Alignment(grid, rows, at, period, segments, False, bridged, False, tuple(warnings))


def _bridged(
    common: IntArray, times: Mapping[str, IntArray], breaks: IntArray, period: int
) -> tuple[IntArray, list[str]]:
    """Add to the common stamps those that single streams lack for a few samples in a row, or all of them."""
    union = reduce(np.union1d, times.values())
    steps = np.diff(union)
    most = _most_bridged(period)
    if not most or (steps < (2.0 - _GAP_PERIODS) * period).any():  # stamps close by each other are no one grid
        return common, []
    lost_by_all = np.rint(steps / period).astype(np.int64) - 1
    inside = (lost_by_all > 0) & (lost_by_all <= most) & (np.abs(steps - (lost_by_all + 1) * period) < 0.1 * period)
    extra = [
        union[k] + np.rint(np.arange(1, lost_by_all[k] + 1) * (steps[k] / (lost_by_all[k] + 1))).astype(np.int64)
        for k in np.flatnonzero(inside)
    ]
    union = np.union1d(union, np.concatenate([*extra, np.zeros(0, np.int64)]))
    kept = np.ones(len(union), dtype=bool)
    lines: list[str] = []
    for name, stamps in times.items():
        lost = ~np.isin(union, stamps, assume_unique=True)
        bridgeable = _in_short_runs(lost, most, np.searchsorted(union, breaks))
        count = int(bridgeable.sum())
        if count > _MOST_LOST * len(union):
            bridgeable[:] = False
        elif count:
            lines.append(
                f"{name}: {count} of {len(union)} samples are missing, no more than {most} in a row; bridged by "
                "interpolation."
            )
        kept &= ~lost | bridgeable
    return union[kept], lines


def _most_bridged(period: int) -> int:
    """How many samples in a row may be bridged at this sample period [ns]."""
    if period > _SLOWEST_BRIDGE_S * NANOSECONDS:
        return 0
    return int(np.clip(_LONGEST_BRIDGE_S * NANOSECONDS / period - 1, 1, MOST_BRIDGED))


def _in_short_runs(lost: BoolArray, most: int, breaks: IntArray) -> BoolArray:
    """Of the lost samples those in runs of at most `most`, with samples on both sides and no break on the way."""
    padded = np.concatenate([[False], lost, [False]]).astype(np.int8)
    starts, stops = np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1)
    out = np.zeros(len(lost), dtype=bool)
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        inner = start > 0 and stop < len(lost) and stop - start <= most
        if inner and not ((breaks >= start) & (breaks <= stop)).any():
            out[start:stop] = True
    return out


def _on_one_clock(
    streams: Mapping[str, Stream],
    times: Mapping[str, IntArray],
    breaks: IntArray,
    warnings: list[str],
    why: str,
    source: str,
    leader: str,
    *,
    even: bool,
    averaged: bool,
) -> Alignment:
    """Find the stretches that every stream covers, and an even clock for each."""
    periods = {name: _period(stamps) for name, stamps in times.items()}
    runs: dict[str, list[tuple[int, int]]] = {}
    times, bridged = dict(times), []
    for name, stamps in list(times.items()):
        most = _most_bridged(periods[name])
        cuts = sorted({*_gaps(stamps, most).tolist(), *np.searchsorted(stamps, breaks).tolist()} - {0, len(stamps)})
        lost = len(_gaps(stamps)) - len(_gaps(stamps, most))
        if lost:
            bridged.append(f"{name}: {lost} gaps of at most {most} lost samples were bridged by interpolation.")
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
    faster = [name for name in times if not streams[name].held and periods[name] < _FASTER * period]
    if averaged and faster:
        lines.append(
            f"the log has sensor noise, and what is put between samples would hide it: so the slowest clock was taken, "
            f"and states of {', '.join(faster)} were averaged over its periods (`rate: fastest` keeps every sample)."
        )
    if period > _SLOW_S * NANOSECONDS:
        lines.append(f"a clock of {NANOSECONDS / period:.4g} Hz is slow for identification; 500 Hz or more is better.")
    lines += bridged
    if len(grids) > 1:
        split = len(grids) - 1
        lines.append(f"{split} gaps split the log." if split > 1 else "1 gap splits the log.")
    edges = np.cumsum([0, *(len(grid) for grid in grids)]).tolist()
    segments = tuple(Segment(start, stop) for start, stop in pairwise(edges))
    stamps = np.concatenate(grids)
    rows = {name: np.arange(len(at)) for name, at in times.items()}
    return Alignment(stamps, rows, times, round(period), segments, True, False, averaged, (*warnings, *lines))


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


def _gaps(stamps: IntArray, bridged: int = 0) -> IntArray:
    """Samples before which there is a gap of more lost samples than may be bridged."""
    return np.flatnonzero(np.diff(stamps) > (_GAP_PERIODS + bridged) * _period(stamps)) + 1


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


def _missing(times: Mapping[str, IntArray], grid: IntArray, bridged: Mapping[str, IntArray]) -> list[str]:
    """State for each topic how many stamps of the others it lacks, bridged ones aside."""
    union = reduce(np.union1d, [grid, *times.values()])
    lines = []
    for name, stamps in times.items():
        lacking = np.setdiff1d(np.setdiff1d(union, stamps, assume_unique=True), bridged[name], assume_unique=True)
        if len(lacking):
            after_s = (lacking[0] - union[0]) / NANOSECONDS
            lines.append(
                f"{name}: no sample for {len(lacking)} of {len(union)} stamps, the first {after_s:.4f} s after "
                "the start; these stamps are left out."
            )
    return lines
