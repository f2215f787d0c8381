"""When updates are shown, and how much of the time axis the plots show."""

from __future__ import annotations

import numpy as np

from massid.typing import FloatArray
from massid.view.motion import Motion
from massid.view.trace import Trace

LINGER = 1.35
"""The plots of a search that ended early end this much later than its last update."""
SHORT_SEARCH = 0.6
"""A search that took less of the walk than this gets plots of its own time range."""
MOST_WORDS = 8
"""Stretches of more passes than this are too short for words."""


def update_times_s(trace: Trace, motion: Motion) -> FloatArray:
    """Times of the walk from which on each row of a trace is shown.

    Online a row is shown from the moment of its update. Offline every pass took the whole log, and no moment of it
    belongs to one pass alone: the model file and the passes get equal stretches of the walk, one after the other, so
    that who plays the walk once has seen the whole search.

    Returns:
        Ascending times from 0 [s], shape (1 + n_updates,).
    """
    if trace.online:
        return trace.update_time_s
    return np.linspace(0.0, float(motion.time_s[-1]), len(trace.update_time_s), endpoint=False)


def pass_names(trace: Trace) -> list[str]:
    """What each row of an offline trace is called in its stretch of the walk: by its number alone in a short one."""
    count = len(trace.updates)
    if count > MOST_WORDS:
        return [str(row) for row in range(1 + count)]
    return ["model file", *(f"pass {row}" for row in range(1, 1 + count))]


def plot_end_s(trace: Trace, motion: Motion) -> float:
    """Time at which the plots end: the walk's end, or soon after the last update of a search that ended early [s].

    A search through several logs ends after the walk that is shown, which is the first of them.
    """
    end_s, last_s = float(motion.time_s[-1]), float(update_times_s(trace, motion)[-1])
    return LINGER * last_s if trace.online and last_s < SHORT_SEARCH * end_s else max(end_s, last_s)
