"""The minimum of a local quadratic in the box Theta."""

from __future__ import annotations

import numpy as np

from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import BoolArray, FloatArray

_TINY = 1e-12
_ACTIVE_SETS = 10


def box_minimum(quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
    """Offset to the minimum of the quadratic in the box Theta, by active sets.

    Coordinates that would leave Theta are held at its border, and released when the slope leads back inside.
    Directions without any curvature are left alone.

    Args:
        quadratic: mu around its centre.
        space: Theta.
    """
    low, high = space.lower - quadratic.centre, space.upper - quadratic.centre
    curvature = quadratic.curvature
    scale = np.sqrt(np.diagonal(curvature))
    scale = np.where(scale > 0.0, scale, 1.0)
    normalised = curvature / np.outer(scale, scale)
    free: BoolArray = np.ones(len(space), dtype=np.bool_)
    step = np.zeros(len(space))
    for _ in range(_ACTIVE_SETS * len(space)):
        held = quadratic.gradient + curvature @ np.where(free, 0.0, step)
        solution, *_ = np.linalg.lstsq(normalised[np.ix_(free, free)], -(held / scale)[free], rcond=1e-14)
        step[free] = solution / scale[free]
        outside = free & ((step < low) | (step > high))
        if outside.any():
            step = np.clip(step, low, high)
            free = free & ~outside
            continue
        slope = (quadratic.gradient + curvature @ step) / scale
        inward = np.where(step <= low, -slope, slope)
        wants_back = ~free & (inward > _TINY)
        if not wants_back.any():
            break
        free[np.argmax(np.where(wants_back, inward, -np.inf))] = True
    return np.clip(step, low, high)
