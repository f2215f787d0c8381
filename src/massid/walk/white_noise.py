"""The level of white noise in signals that move smoothly otherwise."""

from __future__ import annotations

import numpy as np

from massid.typing import FloatArray
from massid.walk.walk import Walk

_THIRD_DIFFERENCE_GAIN = np.sqrt(20.0)
_QUIET_QUANTILE, _QUIET_NORMAL = 0.25, 0.31864
"""The quarter of the samples that change least, and that quantile of |N(0, 1)|."""
CLEAN_VELOCITY = 1e-4
"""A log whose joint velocities have less white noise than this [rad/s] is taken for one without noise."""
_FEWEST_FLIPS = 0.65
"""Third differences of white noise change sign 77 % of the time (correlation -3/4), those of a motion hardly ever."""


def white_level(signal: FloatArray, already_differenced: int = 0) -> float:
    """Standard deviation of the white noise of a group of channels: the median channel's, or 0 if that is smooth.

    Third differences of a motion vanish next to those of white noise, whose deviation they multiply by sqrt(20) and
    whose sign they keep changing. Impacts and steps of a controller disturb few samples; the quarter that changes least
    tells the level.

    Args:
        signal: shape (n, channels).
        already_differenced: how often it was differenced before.
    """
    order = 3 - already_differenced
    if len(signal) < order + 2 or not signal.shape[1]:
        return 0.0
    return float(np.median([_channel_level(np.diff(channel, n=order)) for channel in signal.T]))


def _channel_level(differences: FloatArray) -> float:
    """What third differences of one channel say, shape (n,): one at a time, for a long log has many samples."""
    if np.mean(differences[1:] * differences[:-1] < 0.0) <= _FEWEST_FLIPS:
        return 0.0
    quiet = np.quantile(np.abs(differences), _QUIET_QUANTILE)
    return float(quiet / (_QUIET_NORMAL * _THIRD_DIFFERENCE_GAIN))


def looks_noisy(walk: Walk) -> bool:
    """Whether joint velocities shake from sample to sample; of a stiff servo that may be motion, which forces tell."""
    return white_level(walk.qvel[:, 6:]) >= CLEAN_VELOCITY
