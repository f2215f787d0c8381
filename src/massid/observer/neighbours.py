"""Averages and slopes at a sample from its neighbours on both sides, without itself and those next to it.

Far from impacts a side is a straight line of its own: what its slope keeps of the noise has no mean, so it has nothing
in common with a filter that remembers for longer than a reach. Where something jumps, such lines see nothing of it, for
it is over within the gap. One line through both sides does, and the shorter the more; it is taken where it differs by
more than noise can make it.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d

from massid.observer.spans import Spans
from massid.typing import FloatArray

SURE = 15.0
"""Standard deviations of noise that lines must differ by. Noise has a say where they differ by nearly that, and in what
is let in, and both have something in common with the output error. At 7 a walk of 156 kg (10 s, `realistic`, ten draws)
had a torso 0.55 deviations off and 0.18 kg of error; at 15 and 25 a quarter of a deviation, as without shorter lines,
and 0.16 kg. Of feet that stamp 2 % less is known at 15 than at 7, and 7 % less at 25."""


def level(rows: FloatArray, own: slice, spans: Spans) -> FloatArray:
    """Averages of both sides' neighbours, for some of the rows.

    Always of the widest: shorter ones were no better for feet that stamp, and let in noise of torques and wrenches.
    """
    width = spans.reach - spans.gap
    return _from_sides(rows, own, spans.gap, spans.reach, np.full(width, 1.0 / width))


def slope(rows: FloatArray, own: slice, spans: Spans, std: FloatArray | None = None) -> FloatArray:
    """Slopes of straight lines through both sides' neighbours, for some of the rows, per row.

    Args:
        rows: readings, shape (n, channels).
        own: for which of them.
        spans: gaps and reaches.
        std: of the readings' white noise, shape (channels,), by which shorter lines are judged that take the place of
            longer ones where something jumps; None to keep to the widest neighbours everywhere.
    """
    weights = _slope_weights(spans.reach - spans.gap)
    found, spread = _from_sides(rows, own, spans.gap, spans.reach, weights), float(np.linalg.norm(weights))
    if std is None:
        return found
    k, n = np.arange(own.start, own.stop), len(rows)
    for gap, reach in spans.finer:
        weights = _slope_weights(reach - gap)
        value = _from_sides(rows, own, gap, reach, weights)
        before, spread = spread, float(np.linalg.norm(weights))
        inside = (k >= reach) & (k < n - reach)
        differs = np.abs(value - found) > SURE * np.hypot(before, spread) / np.sqrt(2.0) * std
        found = np.where(differs & inside[:, None], value, found)
    return found


def _slope_weights(width: int) -> FloatArray:
    offsets = np.arange(width) - 0.5 * (width - 1)
    return np.asarray(offsets / (offsets @ offsets))


def _from_sides(rows: FloatArray, own: slice, gap: int, reach: int, weights: FloatArray) -> FloatArray:
    """Mean of the weighted neighbours before and after; of one side alone where the other has not been measured."""
    n, width = len(rows), len(weights)
    if n < width:  # as for the last samples of a short log
        whole = rows.mean(axis=0) * weights.sum()
        return np.repeat(whole[None], own.stop - own.start, axis=0)
    sums = correlate1d(rows, weights, axis=0, origin=-(width // 2))[: n - width + 1]  # of rows k .. k + width - 1
    k = np.arange(own.start, own.stop)
    before, after = k - reach, k + gap + 1
    has_before, has_after = before >= 0, after <= n - width
    neither = ~(has_before | has_after)
    share = has_after / np.maximum(has_before.astype(int) + has_after, 1)
    nearest = np.clip(k - width // 2, 0, n - width)
    first = np.where(neither, nearest, np.clip(before, 0, n - width))
    return np.asarray((1.0 - share)[:, None] * sums[first] + share[:, None] * sums[np.clip(after, 0, n - width)])
