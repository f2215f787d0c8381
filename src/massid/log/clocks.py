"""Put the clock of every stream in order before streams are compared: late messages, restarts, clocks that are off.

Stamps are times only within one run of one clock. Where a simulation is reset they start again while the log goes on,
and on another computer they count from another moment. The times of recording, which all topics share, tell.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from massid.errors import LogError
from massid.typing import BoolArray, IntArray
from massid.walk.conventions import NANOSECONDS

_AROUND = 32
"""Samples on either side of a step back that tell a restart from a message that came late."""
_LEAST_RUN = 3
_TOO_CLOSE = 0.5  # of a period: sorted samples this close are not of one clock
_LEAST_PAUSE_NS = NANOSECONDS
_OTHER_CLOCK_NS = NANOSECONDS // 2
"""No message is under way for so long: what is off by more is another clock."""
_DOUBTFUL_NS = NANOSECONDS // 66
"""A message may be under way for this long, or its clock be off: that is said."""
_STEADY = 0.1  # quartiles of a constant offset scatter by less than this share of it
_TOGETHER = 0.5  # share of a stream that must have been recorded while the reference was


@dataclass(frozen=True)
class Stream:
    """Samples with a clock of their own.

    Attributes:
        stamps_ns: [ns], shape (n,); in the order of the file until they are settled, then strictly increasing.
        held: each value acts until the next sample, as torques and forces do.
        log_ns: when each was recorded [ns], shape (n,); None if the stamps are that.
    """

    stamps_ns: IntArray
    held: bool
    log_ns: IntArray | None = None


@dataclass(frozen=True)
class Settled:
    """Streams on one clock.

    Attributes:
        streams: by name; stamps strictly increase.
        rows: by name, which samples these are, in their order.
        breaks_ns: stamps before which some clock jumped [ns].
        warnings: what was found, one line each.
    """

    streams: Mapping[str, Stream]
    rows: Mapping[str, IntArray]
    breaks_ns: IntArray
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class _Ordered:
    """A stream in order: `rows` of it, with the places in `rows` at which its clock restarts, or only jumped."""

    rows: IntArray
    restarts: tuple[int, ...]
    jumps: tuple[int, ...]
    lines: tuple[str, ...]


def settle(streams: Mapping[str, Stream], source: str) -> Settled:
    """Order the samples of each stream, join runs of a clock that restarts, and take off offsets between clocks.

    Args:
        streams: as they stand in the file; the first is the reference.
        source: name of the file, for messages.

    Raises:
        LogError: a stream has fewer than two samples.
    """
    ordered = {name: _put_in_order(stream) for name, stream in streams.items()}
    for name, one in ordered.items():
        if len(one.rows) < 2:
            why = f" ({'; '.join(one.lines)})" if one.lines else ""
            hint = " If its header stamps are not set, use `clock: log` in a topic map." if one.lines else ""
            raise LogError(f"{source}: {name} holds {len(one.rows)} usable samples, expected at least 2{why}.{hint}")
    warnings = [f"{name}: {line}." for name, one in ordered.items() for line in one.lines]
    rows = {name: one.rows for name, one in ordered.items()}
    breaks = [streams[name].stamps_ns[one.rows[list(one.jumps)]] for name, one in ordered.items() if one.jumps]
    settled = {
        name: stream if _is_whole(rows[name], len(stream.stamps_ns)) else _picked(stream, rows[name])
        for name, stream in streams.items()
    }
    if any(one.restarts for one in ordered.values()):
        settled, starts, line = _joined(settled, {name: one.restarts for name, one in ordered.items()})
        breaks = [np.array(starts, np.int64)]  # those within a run are gaps, too
        warnings.append(line)
        for name, stream in settled.items():
            sound = np.concatenate([[True], np.diff(np.maximum.accumulate(stream.stamps_ns)) > 0])
            settled[name], rows[name] = _picked(stream, np.flatnonzero(sound)), rows[name][sound]
    settled, lines = _on_one_clock(settled)
    warnings += lines
    return Settled(settled, rows, np.concatenate([*breaks, np.zeros(0, np.int64)]), tuple(warnings))


def _picked(stream: Stream, rows: IntArray) -> Stream:
    log = None if stream.log_ns is None else stream.log_ns[rows]
    return replace(stream, stamps_ns=stream.stamps_ns[rows], log_ns=log)


def _is_whole(rows: IntArray, count: int) -> bool:
    return len(rows) == count and bool((rows == np.arange(count)).all())


def _put_in_order(stream: Stream) -> _Ordered:
    """Sort messages that came late, find restarts, and leave out stamps that fit no forward clock."""
    stamps = stream.stamps_ns
    rows = np.arange(len(stamps))
    if (np.diff(stamps) > 0).all():
        return _Ordered(rows, (), (), ())
    lines: list[str] = []
    wild = _wild(stamps)
    rows = rows[~wild]
    if stream.log_ns is not None and not _restarts_itself(stamps[rows], stream.log_ns[rows]):
        by_log = rows[np.argsort(stream.log_ns[rows], kind="stable")]
        if (np.diff(stamps[by_log]) <= 0).sum() < (np.diff(stamps[rows]) <= 0).sum():
            rows = by_log
    cuts = _restarts(stamps[rows])
    kept: list[IntArray] = []
    jumps: list[int] = []
    repeated: list[int] = []
    left_out: list[int] = np.flatnonzero(wild).tolist()
    starts: list[int] = []
    late = 0
    for start, stop in pairwise([0, *cuts, len(rows)]):
        run = _forward(stamps, rows[start:stop])
        at = sum(len(part) for part in kept)
        starts.append(at)
        jumps += [at + jump for jump in run.jumps]
        repeated += run.repeated
        left_out += run.left_out
        late += run.late
        kept.append(run.rows)
    late += int((np.diff(rows) < 0).sum())
    if repeated:
        lines.append(f"{len(repeated)} samples repeat the stamp before them, first sample {min(repeated)}; left out")
        if len(repeated) > len(stamps) // 2:
            lines[-1] += " (stamps that are not set, or too coarse? use `clock: log` in a topic map)"
    if left_out:
        back = np.flatnonzero(np.diff(stamps) < 0)
        at = int(back[0]) + 1
        lines.append(
            f"stamps jump back {len(back)} times, first by {(stamps[at - 1] - stamps[at]) / NANOSECONDS:.4f} s at "
            f"sample {at}; {len(left_out)} samples that do not fit a forward clock are left out"
        )
    if late and not left_out:
        lines.append(f"{late} of {len(stamps)} messages came out of order; sorted by their stamps")
    out = np.concatenate(kept)
    return _Ordered(out, tuple(starts[1:]), tuple(sorted({j for j in jumps if 0 < j < len(out)})), tuple(lines))


def _restarts_itself(stamps: IntArray, log_ns: IntArray) -> bool:
    """Whether times of recording restart with the stamps, as those of a simulation do: they order nothing."""
    edges = [0, *_restarts(stamps), len(stamps)]
    ranges = sorted((int(log_ns[a:b].min()), int(log_ns[a:b].max())) for a, b in pairwise(edges))
    return any(later[0] <= earlier[1] for earlier, later in pairwise(ranges))


def _wild(stamps: IntArray) -> BoolArray:
    """Samples whose stamp alone is far from those of both neighbours, which follow each other."""
    out = np.zeros(len(stamps), dtype=bool)
    if len(stamps) < _LEAST_RUN:
        return out
    before, here, after = stamps[:-2], stamps[1:-1], stamps[2:]
    steps = np.abs(np.diff(stamps))
    far = _AROUND * max(1, int(np.median(steps)))
    out[1:-1] = (after > before) & (((here < before) & (before - here > far)) | ((here > after) & (here - after > far)))
    return out


def _restarts(stamps: IntArray) -> list[int]:
    """Places at which the clock starts again: what follows lies before what came before, and not only by a little."""
    found: list[int] = []
    for place in (np.flatnonzero(np.diff(stamps) < 0) + 1).tolist():
        if min(place, len(stamps) - place) < _LEAST_RUN:
            continue
        before = np.median(stamps[max(0, place - _AROUND) : place])
        after = np.median(stamps[place : place + _AROUND])
        if after > before:
            continue
        if found and place - found[-1] < _AROUND:
            if stamps[place - 1] - stamps[place] > stamps[found[-1] - 1] - stamps[found[-1]]:
                found[-1] = place
        else:
            found.append(place)
    return found


@dataclass(frozen=True)
class _Run:
    """Rows of one run of a clock in order, and what became of the others."""

    rows: IntArray
    jumps: list[int]
    repeated: list[int]
    left_out: list[int]
    late: int


def _forward(stamps: IntArray, rows: IntArray) -> _Run:
    """Sort the rows of one run; where sorting would mix two clocks, keep the longest part that goes forward."""
    repeats = np.concatenate([[False], np.diff(stamps[rows]) == 0])
    repeated = rows[repeats].tolist()
    rows = rows[~repeats]
    backward = np.diff(stamps[rows]) < 0
    if not backward.any():
        return _Run(rows, [], repeated, [], 0)
    order = np.argsort(stamps[rows], kind="stable")
    steps = np.diff(stamps[rows[order]])
    period = np.median(steps[steps > 0]) if steps.any() else 1
    apart = np.abs(np.diff(order)) > 1
    close = apart & (steps < _TOO_CLOSE * period)
    if not close.any() and np.abs(order - np.arange(len(order))).max() <= _AROUND:
        return _Run(rows[order], [], repeated, [], int(backward.sum()))
    longest = _longest_increasing(stamps[rows])
    jumps = (np.flatnonzero(np.diff(longest) > 1) + 1).tolist()
    left_out = np.delete(rows, longest).tolist()
    return _Run(rows[longest], jumps, repeated, left_out, 0)


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


def _joined(
    streams: Mapping[str, Stream], restarts: Mapping[str, Sequence[int]]
) -> tuple[dict[str, Stream], list[int], str]:
    """Put the runs of a clock that restarts one after the other, on all streams alike.

    Returns:
        The streams, the stamps at which later runs start, and a line that says so.
    """
    cuts = _common_restarts(streams, restarts)
    count = max(map(len, cuts.values()))
    out = {name: stream.stamps_ns.copy() for name, stream in streams.items()}
    edges = {name: [0, *places, len(out[name])] for name, places in cuts.items()}
    starts: list[int] = []
    for run in range(1, count + 1):
        parts = {name: slice(edge[run], edge[run + 1]) for name, edge in edges.items()}
        begun = [out[name][part][0] for name, part in parts.items() if part.stop > part.start]
        ended = [out[name][: part.start].max() for name, part in parts.items() if part.start]
        if not begun or not ended:
            continue
        shift = int(max(ended)) + _LEAST_PAUSE_NS - int(min(begun))
        for name, part in parts.items():
            out[name][part.start :] += shift
        starts.append(int(min(begun)) + shift)
    first = next(name for name, places in restarts.items() if places)
    at = restarts[first][0]
    stamps = streams[first].stamps_ns
    line = (
        f"the clock of the stamps restarts {count} time{'s' * (count > 1)}, on {first} by "
        f"{(stamps[at - 1] - stamps[at]) / NANOSECONDS:.4f} s at sample {at} (a simulation that was reset?): all "
        f"{count + 1} runs are used, none is paired with another."
    )
    return {name: replace(stream, stamps_ns=out[name]) for name, stream in streams.items()}, starts, line


def _common_restarts(streams: Mapping[str, Stream], restarts: Mapping[str, Sequence[int]]) -> dict[str, list[int]]:
    """For each stream the places at which it goes on to the next run: as many for all of them.

    The times of recording tell which restart is which. A stream that shows none, because it was silent or began later,
    is cut where the others are.
    """
    counts = {len(places) for places in restarts.values()}
    if len(counts) == 1:
        return {name: list(places) for name, places in restarts.items()}
    instants: list[list[tuple[int, int, str, int]]] = []  # of each restart: recorded before, after, stream, place
    seen = sorted(
        (int(log[place - 1]), int(log[place]), name, place)
        for name, places in restarts.items()
        if (log := streams[name].log_ns) is not None
        for place in places
    )
    for entry in seen:
        last = instants[-1] if instants else []
        near = bool(last) and entry[0] <= max(one[1] for one in last) + _LEAST_PAUSE_NS
        if near and entry[2] not in {one[2] for one in last}:
            last.append(entry)
        else:
            instants.append([entry])
    cuts: dict[str, list[int]] = {}
    for name, stream in streams.items():
        cuts[name] = []
        for instant in instants:
            own = [place for _, _, owner, place in instant if owner == name]
            log = stream.stamps_ns if stream.log_ns is None else stream.log_ns
            middle = (max(one[0] for one in instant) + min(one[1] for one in instant)) // 2
            cuts[name].append(own[0] if own else int(np.searchsorted(log, middle)))
    return cuts


def _on_one_clock(streams: Mapping[str, Stream]) -> tuple[dict[str, Stream], list[str]]:
    """Shift the stamps of streams whose clock is off by a constant, as the times of recording show."""
    offsets = _offsets(streams)
    if offsets is None:
        return dict(streams), []
    names = list(streams)
    groups: list[list[str]] = []
    for name in sorted(names, key=lambda name: offsets[name]):
        if groups and offsets[name] - offsets[groups[-1][-1]] < _OTHER_CLOCK_NS:
            groups[-1].append(name)
        else:
            groups.append([name])
    most = max(groups, key=lambda group: (len(group), names[0] in group))
    middle = offsets[names[0] if names[0] in most else most[0]]
    doubtful = {name: offsets[name] - middle for name in most if abs(offsets[name] - middle) > _DOUBTFUL_NS}
    doubts = [
        f"header stamps of {name} are {abs(off) / NANOSECONDS:.3g} s {'before' if off > 0 else 'after'} those of the "
        "others when recorded at the same time: its messages are under way that long, or its clock is off; then use "
        "`clock: log` in a topic map."
        for name, off in doubtful.items()
    ]
    if len(groups) < 2:
        return dict(streams), doubts
    reference = streams[most[0]].stamps_ns
    out, lines = dict(streams), []
    for group in groups:
        if group is most:
            continue
        shift = int(np.median([offsets[name] for name in group]) - np.median([offsets[name] for name in most]))
        for name in group:
            own = int(offsets[name]) - int(offsets[most[0]])
            out[name] = replace(streams[name], stamps_ns=_in_phase(streams[name].stamps_ns + own, reference))
        side = "before" if shift > 0 else "after"
        lines.append(
            f"header stamps of {', '.join(sorted(group))} are {abs(shift) / NANOSECONDS:.6g} s {side} those of the "
            "others, while they were recorded at the same time: another clock. They were shifted by that; "
            "`clock: log` in a topic map takes the times of recording instead."
        )
    return out, lines + doubts


def _offsets(streams: Mapping[str, Stream]) -> dict[str, int] | None:
    """How much later than its stamps each stream was recorded, beyond that of the first [ns]; None if nothing tells."""
    first = next(iter(streams.values()))
    if first.log_ns is None:
        return None
    found = {}
    order = np.argsort(first.log_ns, kind="stable")
    recorded = first.log_ns[order]
    late = (first.log_ns - first.stamps_ns)[order]
    for name, stream in streams.items():
        if stream.log_ns is None:
            return None
        inside = (stream.log_ns >= recorded[0]) & (stream.log_ns <= recorded[-1])
        if inside.mean() < _TOGETHER:
            return None
        at = np.clip(np.searchsorted(recorded, stream.log_ns[inside]), 0, len(recorded) - 1)
        beyond = np.sort((stream.log_ns - stream.stamps_ns)[inside] - late[at])
        median = int(beyond[len(beyond) // 2])
        spread = int(beyond[3 * len(beyond) // 4] - beyond[len(beyond) // 4])
        found[name] = median if spread <= _STEADY * abs(median) else 0
    return found


def _in_phase(stamps: IntArray, reference: IntArray) -> IntArray:
    """Shift stamps by less than half a period, so that they fall on those of a stream of the same rate.

    The offset of a clock is known no better than the time that messages were under way.
    """
    period = int(np.median(np.diff(stamps)))
    if abs(period - int(np.median(np.diff(reference)))) > 0.01 * period:
        return stamps
    at = np.clip(np.searchsorted(reference, stamps), 1, len(reference) - 1)
    nearest = np.where(stamps - reference[at - 1] < reference[at] - stamps, reference[at - 1], reference[at])
    off = np.sort(stamps - nearest)
    middle = int(off[len(off) // 2])
    return stamps - middle if abs(middle) <= period // 2 else stamps
