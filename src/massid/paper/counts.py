"""Counts of windows and iterations in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def count(value: int | None) -> str:
    """A number of windows or iterations."""
    return "not reached" if value is None else str(value)


def spread(values: Sequence[int | None]) -> str:
    """Median, least and most of several counts, and how many never got there."""
    reached = [value for value in values if value is not None]
    if not reached:
        return "not reached"
    missed = f", {len(values) - len(reached)} not reached" if len(reached) < len(values) else ""
    return f"{int(np.median(reached))} ({min(reached)}-{max(reached)}){missed}"
