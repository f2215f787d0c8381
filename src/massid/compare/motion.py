"""A log as inverse dynamics needs it: smoothed states, accelerations by differences, torques and wrenches."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
from scipy.signal import butter, sosfiltfilt

from massid.errors import BadInputError
from massid.model.layout import JointLayout
from massid.model.motion import Motion
from massid.typing import FloatArray
from massid.walk import Segment, Walk

FILTER_ORDER = 2
"""Of the Butterworth filter, which runs forwards and backwards."""
EDGE_PERIODS = 0.5
"""Left out at both ends of a segment, where the filter is not settled, in periods of the cut-off."""
SAMPLES_PER_PERIOD = 4.0
"""Samples that are kept per period of the cut-off: what lies closer together says the same."""


def smooth_motion(walk: Walk, layout: JointLayout, cutoff_hz: float | None) -> Motion:
    """Low-pass all channels of a walk by the same zero-phase Butterworth filter, and thin them out.

    Accelerations are differences of velocities over the next sample period. All feet are taken to be loaded, and of no
    joint is it known whether it slides.

    Args:
        walk: with its joints in the model's order.
        layout: addresses of the free joint and the one-axis joints.
        cutoff_hz: of the filter; None takes every sample as it is, for a log without noise.

    Raises:
        BadInputError: the cut-off is not between zero and half of the sample rate, or every segment is too short.
    """
    nyquist_hz = 0.5 / walk.timestep_s
    if cutoff_hz is not None and not 0.0 < cutoff_hz < nyquist_hz:
        raise BadInputError(f"A cut-off of {cutoff_hz:g} Hz does not lie between 0 and {nyquist_hz:g} Hz.")
    edge, every = 0, 1
    if cutoff_hz is not None:
        period = 1.0 / (cutoff_hz * walk.timestep_s)
        edge, every = round(EDGE_PERIODS * period), max(1, round(period / SAMPLES_PER_PERIOD))
    parts = [
        _smooth(walk, layout, segment, cutoff_hz, slice(edge, len(segment) - 1 - edge, every))
        for segment in walk.segments
        if len(segment) > 2 * edge + 2
    ]
    if not parts:
        raise BadInputError(
            f"{walk.source}: no segment is long enough for a cut-off of {cutoff_hz:g} Hz; choose a higher one."
        )
    return Motion(*(np.concatenate([getattr(part, entry.name) for part in parts]) for entry in fields(Motion)))


def _smooth(walk: Walk, layout: JointLayout, segment: Segment, cutoff_hz: float | None, kept: slice) -> Motion:
    rows = slice(segment.start, segment.stop)
    channels = [_one_hemisphere(walk.qpos[rows]), walk.qvel[rows], walk.effort[rows]]
    channels.append(walk.wrench[rows].reshape(len(segment), -1))
    if cutoff_hz is not None:
        filter_ = butter(FILTER_ORDER, cutoff_hz, fs=1.0 / walk.timestep_s, output="sos")
        channels = [sosfiltfilt(filter_, channel, axis=0) for channel in channels]
    qpos, qvel, effort, wrench = channels
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    qvel = layout.to_qvel(qvel)
    qacc = np.diff(qvel, axis=0) / walk.timestep_s
    by_dof = np.zeros_like(qvel)
    by_dof[:, layout.joint_dof] = effort
    effort_rate, wrench_rate = (np.gradient(channel, walk.timestep_s, axis=0)[kept] for channel in (by_dof, wrench))
    return Motion(
        position=layout.to_qpos(qpos)[kept],
        velocity=qvel[kept],
        acceleration=qacc[kept],
        effort=by_dof[kept],
        wrench=wrench[kept],
        effort_rate=effort_rate,
        wrench_rate=wrench_rate,
        loaded=np.ones_like(wrench_rate),
        sliding=np.zeros_like(effort_rate),
    )


def _one_hemisphere(qpos: FloatArray) -> FloatArray:
    """Turn the signs of the base quaternions so that they change smoothly."""
    out = qpos.copy()
    same = np.sum(out[1:, 3:7] * out[:-1, 3:7], axis=1) >= 0.0
    out[1:, 3:7] *= np.cumprod(np.where(same, 1.0, -1.0))[:, None]
    return out
