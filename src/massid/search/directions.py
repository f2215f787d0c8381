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
        """Offset to the minimum; coordinates that would leave Theta stop at its border, the others make up for it."""
        free: BoolArray = np.ones(len(space), dtype=np.bool_)
        step = np.zeros(len(space))
        while free.any():
            held = quadratic.gradient + quadratic.curvature @ np.where(free, 0.0, step)
            step[free] = _solve(quadratic, held, free)
            target = quadratic.centre + step
            outside = free & ((target < space.lower) | (target > space.upper))
            if not outside.any():
                return step
            step[outside] = space.project(target)[outside] - quadratic.centre[outside]
            free = free & ~outside
        return step


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
