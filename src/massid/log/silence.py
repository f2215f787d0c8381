"""A contact sensor that publishes only while it is loaded: its silence is no force, and not a loss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massid.log.clocks import Stream
from massid.log.signals import Signal
from massid.log.topics.map import Silence
from massid.typing import FloatArray, IntArray
from massid.walk.conventions import NANOSECONDS

_LEAST_PERIODS = 5.5
"""A sensor that misses fewer samples lost them."""
_FADED = 0.25
"""Share of the usual force below which the last reading before a silence says that the load was going."""


def fill_silence(
    signals: Sequence[Signal], stream: Stream, clock: IntArray, silence: Silence
) -> tuple[Stream, list[FloatArray], str | None]:
    """Put zeros where a contact topic is silent although the log goes on.

    Args:
        signals: the wrenches on this topic, in the order of the stream's stamps.
        stream: its settled clock.
        clock: settled stamps of a stream that does not fall silent [ns].
        silence: what silence means; with `auto`, no force if the readings before each silence fade and none is zero.

    Returns:
        The stream and the values of each signal with the zeros, and a line that says so; None if nothing was done.
    """
    stamps = stream.stamps_ns
    values = [signal.values for signal in signals]
    steps = np.diff(stamps)
    period = max(np.median(steps), np.median(np.diff(clock)))
    runs_on = np.searchsorted(clock, stamps[1:]) - np.searchsorted(clock, stamps[:-1], side="right")
    gaps = np.flatnonzero((steps > _LEAST_PERIODS * period) & (runs_on >= _LEAST_PERIODS - 1.0))
    starts = [int(stamps[k]) for k in gaps] + [int(stamps[-1])]
    stops = [int(stamps[k + 1]) for k in gaps] + [int(clock[-1] + period)]
    if clock[0] < stamps[0] - _LEAST_PERIODS * period:
        starts.insert(0, int(clock[0]) - 1 - int(period))
        stops.insert(0, int(stamps[0]))
    stretches = [(a, b) for a, b in zip(starts, stops, strict=True) if b - a > _LEAST_PERIODS * period]
    if silence is Silence.LOST or not stretches:
        return stream, values, None
    force = np.hypot.reduce(np.hstack([value[:, :3] for value in values]), axis=1)
    if silence is Silence.AUTO:
        usual = float(np.median(force))
        ends = force[gaps] if len(gaps) else force[-1:]
        if not len(gaps) or (force == 0.0).any() or (ends > _FADED * usual).mean() > _FADED:
            return stream, values, None
    quiet = np.zeros(len(clock), dtype=bool)
    margin = 0.5 * period
    for start, stop in stretches:
        quiet |= (clock > start + margin) & (clock < stop - margin)
    added = clock[quiet]
    joined = np.concatenate([stamps, added])
    order = np.argsort(joined, kind="stable")
    filled = [np.vstack([value, np.zeros((len(added), value.shape[1]))])[order] for value in values]
    longest_s = max(b - a for a, b in stretches) / NANOSECONDS
    line = f"silent in {len(stretches)} stretches of up to {longest_s:.2f} s, taken for no contact and no force"
    if silence is Silence.AUTO:
        line += (
            ", as its readings fade before them (`silence: zero` or `silence: lost` in the contact's map says which)"
        )
    return replace(stream, stamps_ns=joined[order], log_ns=None), filled, line
