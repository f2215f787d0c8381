"""Levenberg-Marquardt from the Gram matrix: damping that grows when a step was taken back."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from massid.search.directions.box import box_minimum
from massid.search.directions.direction import Makers
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

FIRST_DAMPING = 0.1
RAISE, LOWER = 4.0, 0.2
LEAST_DAMPING = 1e-9


class LevenbergMarquardtDirection:
    """Minimum of mu + nu sum H_jj d_j^2 / 2 in Theta.

    nu is lowered while the line search keeps the steps and raised when it goes back to where it came from: scores of
    different windows cannot be compared, but centre and candidates run in the same one.
    """

    second_order: ClassVar[bool] = True

    def __init__(self) -> None:
        self._damping = FIRST_DAMPING
        self._from: FloatArray | None = None

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset to the damped minimum, a point of Theta."""
        if self._from is not None:
            stayed = bool(np.array_equal(quadratic.centre, self._from))
            self._damping = max(LEAST_DAMPING, self._damping * (RAISE if stayed else LOWER))
        self._from = quadratic.centre
        diagonal = np.diag(np.diagonal(quadratic.curvature))
        return box_minimum(replace(quadratic, curvature=quadratic.curvature + self._damping * diagonal), space)


MAKERS: Makers = {"levenberg-marquardt": lambda step_size: LevenbergMarquardtDirection()}
