"""Match messages that were stamped one by one when they were sent, though they belong to one cycle of a controller.

Each stream's stamps scatter about an even clock. Where the clocks of all streams are one, and no further apart than
their stamps scatter, the samples of a cycle are those with the same number, whatever their stamps say.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from massid.typing import IntArray
from massid.walk.conventions import NANOSECONDS

_LEAST_SAMPLES = 10
_SAME_RATE = 0.05
_STILL = 1e-3  # of a period: stamps that scatter less than this tell the times of their samples
_WIDEST = 0.45  # of a period, either way: beyond it, stamps do not tell the cycle
_SURE = 4.0  # standard deviations of the period
_ROUNDED_TWICE = 2.0  # when written, and when the unit was changed
_ROUND_NS = (10**6, 10**5, 10**4, 10**3, 10**2)


@dataclass(frozen=True)
class Cycles:
    """Streams on the even clock of their cycles.

    Attributes:
        times_ns: by stream, the time of the cycle of each sample [ns].
        start_ns: time of cycle 0 [ns].
        period_ns: length of a cycle [ns].
        line: what was done.
    """

    times_ns: Mapping[str, IntArray]
    start_ns: int
    period_ns: float
    line: str

    def on_grid(self, stamps_ns: IntArray) -> IntArray:
        """The cycles at which these stamps lie [ns]."""
        cycle = np.rint((stamps_ns - self.start_ns) / self.period_ns)
        return self.start_ns + np.rint(cycle * self.period_ns).astype(np.int64)


@dataclass(frozen=True)
class _Counted:
    """Cycles of one stream and the even clock through its stamps."""

    cycle: IntArray
    start_ns: float
    period_ns: float
    period_std_ns: float
    scatter_ns: float


def match_cycles(times_ns: Mapping[str, IntArray]) -> Cycles | None:
    """Put the samples of each cycle on one stamp; None if the stamps do not tell that they belong together."""
    origin = int(min(stamps[0] for stamps in times_ns.values()))
    counted: dict[str, _Counted] = {}
    for name, stamps in times_ns.items():
        one = _count(stamps - origin)
        if one is None:
            return None
        counted[name] = one
    periods = [one.period_ns for one in counted.values()]
    if max(periods) > (1.0 + _SAME_RATE) * min(periods):
        return None
    scatter = max(one.scatter_ns for one in counted.values())
    if scatter < _STILL * min(periods):
        return None
    lead = min(counted.values(), key=lambda one: one.period_std_ns)
    cycles, apart = {}, 0.0
    for name, one in counted.items():
        middle = one.cycle[len(one.cycle) // 2]
        off = one.start_ns + middle * one.period_ns - lead.start_ns
        shift = int(np.rint(off / lead.period_ns)) - int(middle)
        phase = off - (shift + middle) * lead.period_ns
        drift = abs(one.period_ns - lead.period_ns) * len(one.cycle)
        if abs(phase) > one.scatter_ns + lead.scatter_ns or drift > _WIDEST * lead.period_ns:
            return None
        apart = max(apart, abs(phase) + one.scatter_ns)
        cycles[name] = one.cycle + shift
    period = _rounded(lead)
    start = origin + round(lead.start_ns)
    times = {name: start + np.rint(cycle * period).astype(np.int64) for name, cycle in cycles.items()}
    line = (
        f"stamps scatter by +-{apart / NANOSECONDS * 1e3:.2g} ms about an even clock of {NANOSECONDS / period:.6g} Hz, "
        "each topic by itself: messages were stamped when they were sent. Those of one cycle were matched."
    )
    return Cycles(times, start, period, line)


def evened(stamps: IntArray, rounding_ns: float) -> IntArray:
    """Stamps of an even clock without what rounding put in; as they are if they scatter by more.

    Args:
        stamps: [ns], shape (n,).
        rounding_ns: difference between neighbouring numbers of the type in which they were stored [ns].
    """
    counted = _count(stamps - stamps[0]) if rounding_ns > 1.0 else None
    if counted is None or counted.scatter_ns > _ROUNDED_TWICE * rounding_ns:
        return stamps
    start = int(stamps[0]) + round(counted.start_ns)
    return np.asarray(start + np.rint(counted.cycle * _rounded(counted)).astype(np.int64), dtype=np.int64)


def _count(stamps: IntArray) -> _Counted | None:
    """Number the cycles of a stream; None if its stamps scatter too much for that."""
    if len(stamps) < _LEAST_SAMPLES:
        return None
    steps = np.diff(stamps).astype(np.float64)
    median = float(np.median(steps))
    usual = steps[np.abs(steps - median) < _WIDEST * 2.0 * median]
    period = float(usual.mean()) if len(usual) else median
    cycle = np.concatenate([[0], np.cumsum(np.rint(steps / period))])
    start = 0.0
    for _ in range(3):
        if (np.diff(cycle) <= 0).any():
            return None
        period, start = np.polyfit(cycle, stamps.astype(np.float64), 1)
        cycle = np.rint((stamps - start) / period)
    if (np.diff(cycle) <= 0).any():
        return None
    rest = stamps - start - cycle * period
    scatter = float(np.quantile(np.abs(rest), 0.995))
    if scatter > _WIDEST * period:
        return None
    spread = float(np.std(cycle)) * np.sqrt(len(cycle))
    return _Counted(cycle.astype(np.int64), float(start), float(period), float(np.std(rest)) / spread, scatter)


def _rounded(lead: _Counted) -> float:
    """The roundest period that the stamps do not rule out [ns]."""
    for unit in _ROUND_NS:
        rounded = round(lead.period_ns / unit) * unit
        if rounded and abs(rounded - lead.period_ns) <= _SURE * lead.period_std_ns:
            return float(rounded)
    return lead.period_ns
