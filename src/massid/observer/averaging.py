"""How far around a sample its motion is averaged: as far as that pays, found by cross-validation.

The columns of the Jacobian are made of accelerations that are slopes of measured velocities. A slope over a longer time
has less noise, (time)^-1.5, but blurs what changes within it: 20 ms suit a walk with its impacts, a robot that shifts
its weight bears 100 ms. Columns that drown in their noise leave nothing to be weighed by.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import correlate1d

from massid.observer.neighbours import slope
from massid.observer.spans import REACH_S, Spans
from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import SensorNoise

REACHES_S = (REACH_S, 0.04, 0.08, 0.16)
"""What is tried [s]; the first, which suits a walk, is the shortest that shares little noise with the output error."""
EXPLAINED = 1.1
"""Mean square, in units of the noise, up to which nothing but noise is left of the difference to a slope."""


def suitable_reach_s(walk: Walk, noise: SensorNoise) -> float:
    """The reach whose slopes come nearest to those that the samples in the gap show, in which they have no part [s].

    What then is left between the two is the noise of the samples in the gap. Where it is more, as at impacts and when a
    joint slips, no average follows the motion, and the shortest blurs least of it.

    Args:
        walk: the log.
        noise: of its sensors.
    """
    trials = [Spans.at(walk.timestep_s, reach_s) for reach_s in REACHES_S]
    joints = walk.qvel.shape[1] - 6
    velocity = walk.qvel / noise.state_std(joints)[6 + joints :]
    margin = trials[-1].reach
    segments = [segment for segment in walk.segments if len(segment) > 2 * margin + 1]
    if not segments:
        return REACH_S
    errors = np.zeros(len(trials))
    for segment in segments:
        for k, spans in enumerate(trials):
            errors[k] += float(np.sum(_differences(velocity, segment, spans, margin) ** 2))
    errors /= velocity.shape[1] * sum(len(segment) - 2 * margin for segment in segments)
    best = int(np.argmin(errors))
    return REACHES_S[best] if errors[best] < EXPLAINED else REACH_S


def _differences(velocity: FloatArray, segment: Segment, spans: Spans, margin: int) -> FloatArray:
    """Between slopes in the gap and slopes around it, with the noise of the former as unit, shape (n, nv).

    Args:
        velocity: with its noise as unit.
        segment: of the log.
        spans: gap and reach.
        margin: samples at both ends that are left out, the longest reach of all.
    """
    rows = velocity[segment.start : segment.stop]
    inside = slice(margin, len(rows) - margin)
    offsets = np.arange(-spans.gap, spans.gap + 1)
    spread = float(offsets @ offsets)
    shown = correlate1d(rows, offsets / spread, axis=0)[inside]
    return np.asarray((shown - slope(rows, inside, spans)) * np.sqrt(spread))
