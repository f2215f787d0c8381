"""Averages and slopes at a sample from its neighbours on both sides, without itself and those next to it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d

from massid.observer.spans import Spans
from massid.typing import FloatArray


def level(rows: FloatArray, own: slice, spans: Spans) -> FloatArray:
    """Averages of both sides' neighbours, for some of the rows."""
    width = spans.reach - spans.gap
    return _from_sides(rows, own, spans, np.full(width, 1.0 / width))


def slope(rows: FloatArray, own: slice, spans: Spans) -> FloatArray:
    """Slopes of straight lines through both sides' neighbours, for some of the rows, per row."""
    width = spans.reach - spans.gap
    offsets = np.arange(width) - 0.5 * (width - 1)
    return _from_sides(rows, own, spans, offsets / (offsets @ offsets))


def _from_sides(rows: FloatArray, own: slice, spans: Spans, weights: FloatArray) -> FloatArray:
    """Mean of the weighted neighbours before and after; of one side alone where the other has not been measured."""
    n, width = len(rows), len(weights)
    if n < width:  # as for the last samples of a short log
        whole = rows.mean(axis=0) * weights.sum()
        return np.repeat(whole[None], own.stop - own.start, axis=0)
    sums = correlate1d(rows, weights, axis=0, origin=-(width // 2))[: n - width + 1]  # of rows k .. k + width - 1
    k = np.arange(own.start, own.stop)
    before, after = k - spans.reach, k + spans.gap + 1
    has_before, has_after = before >= 0, after <= n - width
    neither = ~(has_before | has_after)
    share = has_after / np.maximum(has_before.astype(int) + has_after, 1)
    nearest = np.clip(k - width // 2, 0, n - width)
    first = np.where(neither, nearest, np.clip(before, 0, n - width))
    return np.asarray((1.0 - share)[:, None] * sums[first] + share[:, None] * sums[np.clip(after, 0, n - width)])
