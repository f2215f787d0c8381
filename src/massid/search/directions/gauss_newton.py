"""Gauss-Newton from the Gram matrix of the models: the default direction."""

from __future__ import annotations

from typing import ClassVar

from massid.search.directions.box import box_minimum
from massid.search.directions.direction import Makers
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

_NEWTON_STEPS = 30


class GaussNewtonDirection:
    """Step to the minimum of the Gauss-Newton quadratic in Theta, shortened by the misfit of the affine picture.

    The samples show how far the output error is from affine: those that changed mu by `explained` left `misfit`
    unexplained. What is not affine grows with the square of what is, so a fraction alpha of the full step, which would
    lower mu by D, is expected to cost misfit (alpha^2 D / explained)^2. The best alpha solves

        alpha + 2 alpha^3 D misfit / explained^2 = 1.

    Directions that hardly show in the output are not held back, as they would be by a damping that adds to the
    curvature; close to p* the full step remains.
    """

    second_order: ClassVar[bool] = True

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset to the damped minimum, a point of Theta."""
        full = box_minimum(quadratic, space)
        decrease = quadratic.change(full, space.n_sampled)
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


MAKERS: Makers = {"gauss-newton": lambda step_size: GaussNewtonDirection()}
