"""One quantity of a walk over the messages that hold it, and on the clock of the walk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.signal import savgol_filter

from massid.log.alignment import Alignment
from massid.log.clocks import Stream
from massid.log.columns import TopicColumns
from massid.typing import BoolArray, FloatArray, IntArray
from massid.walk import resampling
from massid.walk.conventions import NANOSECONDS

_LARGEST = 1e100  # its square is still a number
_MOST = 0.5  # share of the samples beyond which a channel holds no number rather than losing some
_LISTED = 6
_GAP = 1.5  # of a period
_FEWEST = 3
_FEW, _SLOWEST_S = 0.1, 0.02  # share of the samples, and sample period, up to which single values are interpolated


@dataclass
class Signal:
    """One quantity over all messages of its topic.

    Attributes:
        columns: the topic, or those of its messages that hold the quantity.
        values: shape (n, width); once settled, in the order of the stream's stamps.
        held: each value acts until the next one.
        lag_s: how much later than they should be its samples are stamped [s].
        holes: values that were no numbers and are to be interpolated, shape (n, width); None for none.
        is_attitude: whether the values are unit quaternions.
    """

    columns: TopicColumns
    values: FloatArray
    held: bool = False
    lag_s: float = 0.0
    holes: BoolArray | None = None
    is_attitude: bool = False

    @property
    def stream(self) -> str:
        """Name of the clock: the topic's own, or that less a lag."""
        name = self.columns.name
        return name if self.lag_s == 0.0 else f"{name} (less {self.lag_s * 1e3:g} ms)"

    def clock(self, *, by_log: bool) -> Stream:
        """Stamps of the samples that can be used, in the order of the file."""
        usable, header = self.columns.usable(), self.columns.header_ns()
        log = self.columns.log_ns()[usable]
        lag_ns = round(self.lag_s * NANOSECONDS)
        if by_log or header is None:
            return Stream(log - lag_ns, self.held)
        return Stream(header[usable] - lag_ns, self.held, log)

    def settle(self, rows: IntArray, stamps_ns: IntArray) -> None:
        """Keep these of the usable samples, in this order, and fill their holes.

        Args:
            rows: of the usable samples.
            stamps_ns: theirs, increasing [ns].
        """
        rows = self.columns.usable()[rows]
        if len(rows) != len(self.values) or (np.diff(rows) != 1).any():
            self.values = self.values[rows]
        if self.holes is None:
            return
        holes = self.holes[rows]
        for column in np.flatnonzero(holes.any(axis=0)):
            hole = holes[:, column]
            sound = stamps_ns[~hole] - stamps_ns[0]
            self.values[hole, column] = np.interp(stamps_ns[hole] - stamps_ns[0], sound, self.values[~hole, column])

    def average(self, alignment: Alignment) -> None:
        """Average a state that comes more often than the walk's samples, by quadratics along two of their periods.

        A mean would lag where the state bends; a quadratic takes as much of the noise off as the mean of one period.
        """
        times = self.times(alignment)
        steps = np.diff(times)
        reach = round(alignment.period_ns / float(np.median(steps)))
        if not alignment.averaged or self.held or reach < 2:
            return
        self.values = resampling.signs_aligned(self.values) if self.is_attitude else self.values.copy()
        edges = [0, *(np.flatnonzero(steps > _GAP * np.median(steps)) + 1).tolist(), len(times)]
        for start, stop in pairwise(edges):
            if stop - start > 2 * reach:
                self.values[start:stop] = savgol_filter(self.values[start:stop], 2 * reach + 1, 2, axis=0)
        if self.is_attitude:
            self.values /= np.linalg.norm(self.values, axis=1, keepdims=True)

    def rows(self, alignment: Alignment) -> FloatArray:
        """The values that the alignment uses."""
        rows = alignment.rows[self.stream]
        return self.values if len(rows) == len(self.values) else self.values[rows]

    def times(self, alignment: Alignment) -> IntArray:
        """Stamps of these values [ns]."""
        return alignment.times_ns[self.stream]

    def on(self, alignment: Alignment) -> FloatArray:
        """The signal on the alignment's clock: itself, a straight line, or the mean of what was held."""
        values = self.rows(alignment)
        if alignment.exact:
            return values
        if self.held and alignment.resampled:
            return resampling.held_mean(self.times(alignment), values, alignment.stamps_ns, alignment.period_ns)
        return resampling.linear(self.times(alignment), values, alignment.stamps_ns)


def check_finite(
    columns: TopicColumns, values: FloatArray, names: Sequence[str], advice: str = "", *, apart: bool = False
) -> BoolArray | None:
    """Leave out rows that are not finite, and put zeros there; a channel's values lost one by one become holes.

    Args:
        columns: whose rows these are.
        values: shape (n, width); written to.
        names: what each column is.
        advice: what to do about columns that hold no number in most rows.
        apart: channels do not depend on each other, so one of them may be interpolated.

    Returns:
        Values to be interpolated, shape (n, width); None for none.
    """
    bad = ~(np.abs(values) < _LARGEST)
    if bad.any():
        row, column = np.argwhere(bad)[0]
        value = values[row, column]
        expected = f"a number below {_LARGEST:g}" if np.isfinite(value) else "a finite number"
        reason = f"sample {row}: {names[column]} is {value}, expected {expected}"
        never = np.flatnonzero(bad.mean(axis=0) > _MOST)
        if len(never):
            listed = ", ".join(names[k] for k in never[:_LISTED])
            more = f" and {len(never) - _LISTED} more" if len(never) > _LISTED else ""
            others = f"; so in most samples: {listed}{more}" if len(never) > 1 else ""
            reason += others + (f". {advice}" if advice else "")
        holes = _holes(columns, bad) if apart else np.zeros_like(bad)
        values[bad] = 0.0
        columns.leave_out(np.asarray((bad & ~holes).any(axis=1)), reason)
        if holes.any():
            columns.bridge(np.asarray(holes.any(axis=1)), reason)
            return holes
    return None


def _holes(columns: TopicColumns, bad: BoolArray) -> BoolArray:
    """Of the values that are no numbers those that stand alone in their channel, in few rows, not in all of them."""
    if len(bad) < _FEWEST:
        return np.zeros_like(bad)
    times = columns.header_ns()
    period_ns = float(np.median(np.diff(columns.log_ns() if times is None else times)))
    out = np.zeros_like(bad)
    if bad.all(axis=1).any() or bad.any(axis=1).mean() > _FEW or period_ns > _SLOWEST_S * NANOSECONDS:
        return out
    alone = bad.copy()
    alone[1:] &= ~bad[:-1]
    alone[:-1] &= ~bad[1:]
    alone[[0, -1]] = False
    return np.asarray(alone & ~(bad & ~alone).any(axis=0))
