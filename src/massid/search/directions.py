"""Search directions: from a local quadratic to the full step of the line search (Section III, step 2)."""

from __future__ import annotations

from typing import Literal, Protocol, TypeAlias

import numpy as np

from massid.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import BoolArray, FloatArray

DirectionName: TypeAlias = Literal["gauss-newton", "gradient"]

BORDER_DAMPING = 0.7
"""beta of Section III: the factor that shortens a step until it ends inside Theta."""

_TINY = 1e-12


class Direction(Protocol):
    """Computes alpha times the search direction: the offset of the next estimate (Eq. 9)."""

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset from the quadratic's centre to a point of Theta, shape (n_p,)."""


class GradientDirection:
    """The paper's direction: -grad mu, with the step length that the bank's own curvature gives.

    alpha = g^T g / (g^T H g) is the exact minimiser of the local quadratic along the gradient; it is at least 1/L, the
    bound of Theorem 1. Close to the border of Theta it is discounted by beta until the step ends inside.
    """

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset along the negative gradient."""
        g = quadratic.gradient
        along = float(g @ quadratic.curvature @ g)
        if along <= 0.0:
            return np.zeros_like(g)
        step = -(float(g @ g) / along) * g
        for _ in range(60):
            if space.contains(quadratic.centre + step):
                return step
            step = BORDER_DAMPING * step
        return np.zeros_like(g)


class GaussNewtonDirection:
    """Step to the minimum of the Gauss-Newton quadratic in Theta, damped by the misfit of the affine picture."""

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset to the minimum in the box Theta, by active sets: hold what would leave, release what wants back in."""
        low, high = space.lower - quadratic.centre, space.upper - quadratic.centre
        free: BoolArray = np.ones(len(space), dtype=np.bool_)
        step = np.zeros(len(space))
        for _ in range(10 * len(space)):
            step[free] = _solve(quadratic, quadratic.gradient + quadratic.curvature @ np.where(free, 0.0, step), free)
            outside = free & ((step < low) | (step > high))
            if outside.any():
                step = np.clip(step, low, high)
                free = free & ~outside
                continue
            slope = quadratic.gradient + quadratic.curvature @ step + quadratic.damping * step
            inward = np.where(step <= low, -slope, slope) / np.sqrt(np.diagonal(quadratic.curvature) + _TINY)
            wants_back = ~free & (inward > _TINY)
            if not wants_back.any():
                break
            free[np.argmax(np.where(wants_back, inward, -np.inf))] = True
        return np.clip(step, low, high)


def _solve(quadratic: LocalQuadratic, gradient: FloatArray, free: BoolArray) -> FloatArray:
    """Damped Newton step in the free coordinates; directions without curvature are left alone."""
    matrix = (quadratic.curvature + np.diag(quadratic.damping))[np.ix_(free, free)]
    scale = np.sqrt(np.diagonal(matrix))
    scale = np.where(scale > 0.0, scale, 1.0)
    solution, *_ = np.linalg.lstsq(matrix / np.outer(scale, scale), -gradient[free] / scale, rcond=1e-14)
    return np.asarray(solution / scale)


DIRECTIONS: dict[DirectionName, Direction] = {
    "gauss-newton": GaussNewtonDirection(),
    "gradient": GradientDirection(),
}
