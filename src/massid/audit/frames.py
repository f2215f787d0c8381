"""Is a twist of the base given in the other frame? Told from how the rest of its path goes along with the difference.

On a straight walk both frames are nearly one, and the noise of single poses hides what is between them. But it is
known how the rest would look if the other frame were right: like the difference of the two paths. The share of that
difference in the rest is 0 if the frame is right and 1 if the other is, whatever its size; means over parts of each
span, in place of single poses, and a long walk make it sharp.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massid.audit.base_motion import BaseMotion
from massid.typing import FloatArray
from massid.walk.conventions import to_body, to_world
from massid.walk.resampling import from_rotation, multiply, rotation_between

_SPANS_S = (0.1, 0.25, 0.5)
_FEWEST = 24
"""Spans that overlap by half: fewer of them are no sample to take a deviation from."""
_TURNS = 60
"""Steps in which a turn is followed along a span."""
_PARTS = 12
_SURE = 4.0
"""Deviations by which the share must be off 0, where the given frame is right."""
_NEAR, _NEARER = 0.15, 3.0
"""How far off 1 it may be, where the other frame is; or how many deviations."""


def rests(base: BaseMotion, what: str) -> tuple[FloatArray, ...]:
    """What velocities leave of the base's path over spans of several lengths, for `frame_share`; (n, 3) each.

    Args:
        base: how it moved.
        what: "position" or "attitude", which belongs to the linear or to the angular velocity.
    """
    return tuple(_rest(base, span_s, what) for span_s in _SPANS_S)


def frame_share(given: Sequence[FloatArray], other: Sequence[FloatArray]) -> float | None:
    """Share of what tells two readings of a twist apart that the rest of the base's path shows.

    Args:
        given: the `rests` of the motion as read.
        other: those of the same with the twist in the other frame.

    Returns:
        None unless it is surely not 0 and may be 1.
    """
    along: list[FloatArray] = []
    power: list[FloatArray] = []
    for rest, rest_of_other in zip(given, other, strict=True):
        if len(rest) < _FEWEST:
            continue
        difference = rest - rest_of_other
        noise = min(float(np.mean(rest**2)), float(np.mean(rest_of_other**2)))
        weight = 1.0 / noise if noise > 0.0 else 1.0
        along.append(_by_part(weight * np.sum(difference * rest, axis=1)))
        power.append(_by_part(weight * np.sum(difference**2, axis=1)))
    if not power or not np.any(power):
        return None
    upper, lower = np.sum(along, axis=0), np.sum(power, axis=0)
    share = float(upper.sum() / lower.sum())
    without = (upper.sum() - upper) / (lower.sum() - lower)  # the jackknife, over parts of the walk
    deviation = float(np.sqrt((_PARTS - 1) / _PARTS * np.sum((without - without.mean()) ** 2)))
    is_other = share > max(0.5, _SURE * deviation) and abs(share - 1.0) < max(_NEAR, _NEARER * deviation)
    return share if is_other else None


def _by_part(values: FloatArray) -> FloatArray:
    return np.array([part.sum() for part in np.array_split(values, _PARTS)])


def _rest(base: BaseMotion, span_s: float, what: str) -> FloatArray:
    """What velocities leave of the way from the first third of each span to the last, shape (n, 3)."""
    span = max(6, round(span_s / base.step_s))
    runs = [np.arange(one.start, one.stop - span - 1, span // 2) for one in base.segments if len(one) > span + 1]
    if not runs:
        return np.zeros((0, 3))
    starts = np.concatenate(runs)
    rate = base.linear if what == "position" else base.angular
    way = np.zeros_like(rate)
    np.cumsum(0.5 * (rate[1:] + rate[:-1]) * base.step_s, axis=0, out=way[1:])
    third = span // 3
    if what == "position":
        total = np.vstack([np.zeros(3), np.cumsum(base.position - way, axis=0)])
        early = total[starts + third] - total[starts]
        late = total[starts + span] - total[starts + span - third]
        return np.asarray((late - early) / third)
    first = attitude = base.attitude[starts]
    edges = np.linspace(0, span, min(span, _TURNS) + 1).round().astype(np.int64)
    rest = []
    for k, edge in enumerate(edges.tolist()):
        if k:
            attitude = multiply(attitude, from_rotation(way[starts + edge] - way[starts + edges[k - 1]]))
        off = rotation_between(attitude, base.attitude[starts + edge])
        rest.append(to_body(first, to_world(attitude, off)))  # in one frame, so that the first pose's own error cancels
    third = len(edges) // 3
    return np.asarray(np.mean(rest[-third:], axis=0) - np.mean(rest[:third], axis=0))
