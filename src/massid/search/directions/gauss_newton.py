"""Search directions: from a local quadratic to the full step of the line search (Section III, step 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias

import numpy as np

from massid.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import BoolArray, FloatArray

DirectionName: TypeAlias = Literal["gauss-newton", "gradient", "plain-gradient"]

BORDER_DAMPING = 0.7
"""beta of Section III: the factor that shortens a step until it ends inside Theta."""

_TINY = 1e-12
_MOST_DISCOUNTS = 60
_NEWTON_STEPS = 30
_ACTIVE_SETS = 10


class Direction(Protocol):
    """Computes alpha times the search direction: the offset of the next estimate (Eq. 9)."""

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset from the quadratic's centre to a point of Theta, shape (n_p,)."""


@dataclass(frozen=True)
class GradientDirection:
    """The paper's direction: -grad mu, with the step length that the bank's own curvature gives.

    alpha = g^T g / (g^T H g) is the exact minimiser of the local quadratic along the gradient; it is at least 1/L, the
    bound of Theorem 1. Close to the border of Theta it is discounted by beta until the step ends inside.

    Attributes:
        relative: take the gradient with respect to the parameters in units of their scales, so that a kilogram counts
            for more on a foot than on a torso; the paper does not say. With masses in kilograms the Hessian's condition
            is an order of magnitude worse.
    """

    relative: bool = True

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset along the negative gradient."""
        g = quadratic.gradient
        direction = -(space.scale**2) * g if self.relative else -g
        along = float(direction @ quadratic.curvature @ direction)
        if along <= 0.0:
            return np.zeros_like(g)
        step = -float(g @ direction) / along * direction
        for _ in range(_MOST_DISCOUNTS):
            if space.contains(quadratic.centre + step):
                return step
            step = BORDER_DAMPING * step
        return np.zeros_like(g)


class GaussNewtonDirection:
    """Step to the minimum of the Gauss-Newton quadratic in Theta, shortened by the misfit of the affine picture.

    The samples show how far the output error is from affine: those that changed mu by `explained` left `misfit`
    unexplained. What is not affine grows with the square of what is, so a fraction alpha of the full step, which would
    lower mu by D, is expected to cost misfit (alpha^2 D / explained)^2. The best alpha solves

        alpha + 2 alpha^3 D misfit / explained^2 = 1.

    Directions that hardly show in the output are not held back, as they would be by a damping that adds to the
    curvature; close to p* the full step remains.
    """

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset to the damped minimum, a point of Theta."""
        full = box_minimum(quadratic, space)
        decrease = 0.5 * float(full @ quadratic.curvature @ full)
        if quadratic.explained <= 0.0:
            return full
        bend = 2.0 * decrease * quadratic.misfit / quadratic.explained**2
        return _damping_factor(bend) * full


def _damping_factor(bend: float) -> float:
    """Positive root of alpha + bend alpha^3 = 1, by Newton's method from 1."""
    alpha = 1.0
    for _ in range(_NEWTON_STEPS):
        alpha -= (alpha + bend * alpha**3 - 1.0) / (1.0 + 3.0 * bend * alpha**2)
    return alpha


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


DIRECTIONS: dict[DirectionName, Direction] = {
    "gauss-newton": GaussNewtonDirection(),
    "gradient": GradientDirection(),
    "plain-gradient": GradientDirection(relative=False),
}
