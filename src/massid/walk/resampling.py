"""Put a stream on another clock: states are interpolated, held inputs averaged.

Positions follow the cubic that has the measured velocities as its slopes, attitudes the same in the rotation vector
from one sample to the next, velocities a straight line. Torques and wrenches act until the next sample; what they
transfer over each new period is kept, so they become the mean of what was held over it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from massid.typing import FloatArray, IntArray
from massid.walk.conventions import NANOSECONDS
from massid.walk.walk import Segment, Walk


@dataclass(frozen=True)
class Bracket:
    """Where new stamps lie among old ones.

    Attributes:
        index: the old sample before each new stamp, shape (n,).
        share: how far the stamp is on the way to the next sample, 0 to 1, shape (n, 1).
        step_s: time between the two samples [s], shape (n, 1).
    """

    index: IntArray
    share: FloatArray
    step_s: FloatArray

    @classmethod
    def find(cls, times_ns: IntArray, stamps_ns: IntArray) -> Bracket:
        """Bracket stamps by samples; stamps outside stick to the nearest sample."""
        index = np.clip(np.searchsorted(times_ns, stamps_ns, side="right") - 1, 0, len(times_ns) - 2)
        step = times_ns[index + 1] - times_ns[index]
        share = np.clip((stamps_ns - times_ns[index]) / step, 0.0, 1.0)
        return cls(index, share[:, None], (step / NANOSECONDS)[:, None])


def linear(times_ns: IntArray, values: FloatArray, stamps_ns: IntArray) -> FloatArray:
    """Interpolate linearly, shape (n, width)."""
    at = Bracket.find(times_ns, stamps_ns)
    return (1.0 - at.share) * values[at.index] + at.share * values[at.index + 1]


def cubic(times_ns: IntArray, values: FloatArray, slopes: FloatArray, stamps_ns: IntArray) -> FloatArray:
    """Interpolate by cubics with given slopes at the samples [1/s], shape (n, width)."""
    at = Bracket.find(times_ns, stamps_ns)
    return _hermite(at, values[at.index], values[at.index + 1], slopes[at.index], slopes[at.index + 1])


def attitude(times_ns: IntArray, wxyz: FloatArray, rates: FloatArray, stamps_ns: IntArray) -> FloatArray:
    """Interpolate attitudes with body-frame turn rates [rad/s] at the samples, shape (n, 4)."""
    at = Bracket.find(times_ns, stamps_ns)
    start = wxyz[at.index]
    turn = rotation_between(start, wxyz[at.index + 1])
    vector = _hermite(at, np.zeros_like(turn), turn, rates[at.index], rates[at.index + 1])
    return np.where(at.share == 1.0, wxyz[at.index + 1], multiply(start, from_rotation(vector)))


def held_mean(times_ns: IntArray, values: FloatArray, stamps_ns: IntArray, period_ns: float) -> FloatArray:
    """Average, over the period that follows each stamp, a signal that holds every value until the next sample.

    The last value is held for as long as is asked.
    """
    steps_s = np.diff(times_ns) / NANOSECONDS
    centre = values.mean(axis=0)
    integral = np.zeros_like(values)
    np.cumsum((values[:-1] - centre) * steps_s[:, None], axis=0, out=integral[1:])
    ends = stamps_ns + round(period_ns)

    def transferred(stamps: IntArray) -> FloatArray:
        index = np.clip(np.searchsorted(times_ns, stamps, side="right") - 1, 0, len(times_ns) - 1)
        since_s = ((stamps - times_ns[index]) / NANOSECONDS)[:, None]
        return np.asarray(integral[index] + (values[index] - centre) * since_s, dtype=np.float64)

    mean = (transferred(ends) - transferred(stamps_ns)) / (round(period_ns) / NANOSECONDS)
    return np.asarray(centre + mean, dtype=np.float64)


def _hermite(at: Bracket, p0: FloatArray, p1: FloatArray, v0: FloatArray, v1: FloatArray) -> FloatArray:
    u, h = at.share, at.step_s
    u2, u3 = u * u, u * u * u
    return np.asarray(
        (2 * u3 - 3 * u2 + 1) * p0 + (3 * u2 - 2 * u3) * p1 + h * ((u3 - 2 * u2 + u) * v0 + (u3 - u2) * v1),
        dtype=np.float64,
    )


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product of quaternions (wxyz), shape (n, 4)."""
    w = a[:, 0] * b[:, 0] - (a[:, 1:] * b[:, 1:]).sum(axis=1)
    v = a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.column_stack([w, v])


def signs_aligned(wxyz: FloatArray) -> FloatArray:
    """The same attitudes as quaternions of which none jumps to the other sign, shape (n, 4)."""
    turns = np.sum(wxyz[1:] * wxyz[:-1], axis=1) < 0.0
    signs = np.concatenate([[1.0], np.where(np.cumsum(turns) % 2, -1.0, 1.0)])
    return np.asarray(wxyz * signs[:, None])


def rotation_between(a: FloatArray, b: FloatArray) -> FloatArray:
    """Rotation vector, in the frame of the first, from one attitude (wxyz) to another the shorter way, shape (n, 3)."""
    relative = multiply(a * np.array([1.0, -1.0, -1.0, -1.0]), b)
    relative = np.where(relative[:, :1] < 0.0, -relative, relative)
    sine = np.linalg.norm(relative[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, relative[:, :1])
    return np.asarray(relative[:, 1:] * np.where(sine < 1e-12, 2.0, angle / np.maximum(sine, 1e-300)))


def from_rotation(vector: FloatArray) -> FloatArray:
    """Quaternion (wxyz) of a rotation vector, shape (n, 4)."""
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    scale = np.where(angle < 1e-12, 0.5, np.sin(0.5 * angle) / np.maximum(angle, 1e-300))
    return np.hstack([np.cos(0.5 * angle), scale * vector])


def stamped_earlier(walk: Walk, effort_s: float, wrench_s: float) -> Walk:
    """The walk with torques and wrenches that are stamped late put back to when they acted.

    Each becomes the mean of what its readings hold over the sample's period, which is a reading itself where the lag is
    a whole number of periods. Samples for which there is no reading any more leave their segment.

    Args:
        walk: with its sample periods even.
        effort_s: how much later than the state the torques are stamped [s].
        wrench_s: the same of the wrenches [s].
    """
    late = [round(lag_s / walk.timestep_s, 6) for lag_s in (effort_s, wrench_s)]
    before, after = (max(0, math.ceil(max(sign * lag for lag in late))) for sign in (-1.0, 1.0))
    segments = tuple(
        Segment(segment.start + before, segment.stop - after)
        for segment in walk.segments
        if len(segment) > before + after
    )
    effort, wrench = walk.effort.copy(), walk.wrench.copy()
    for segment in segments:
        rows = np.arange(segment.start, segment.stop)
        for values, source, lag in ((effort, walk.effort, late[0]), (wrench, walk.wrench, late[1])):
            below = math.floor(lag)
            share = lag - below
            values[rows] = source[rows + below]
            if share:
                values[rows] = (1.0 - share) * source[rows + below] + share * source[rows + below + 1]
    return replace(walk, effort=effort, wrench=wrench, segments=segments)
