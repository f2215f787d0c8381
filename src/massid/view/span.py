"""How much of the time axis the plots show."""

from __future__ import annotations

from massid.view.motion import Motion
from massid.view.trace import Trace

LINGER = 1.35
"""The plots of a search that ended early end this much later than its last update."""
SHORT_SEARCH = 0.6
"""A search that took less of the walk than this gets plots of its own time range."""


def plot_end_s(trace: Trace, motion: Motion) -> float:
    """Time at which the plots end: the walk's end, or soon after the last update of a search that ended early [s]."""
    end_s, last_s = float(motion.time_s[-1]), float(trace.update_time_s[-1])
    return LINGER * last_s if trace.online and last_s < SHORT_SEARCH * end_s else end_s
