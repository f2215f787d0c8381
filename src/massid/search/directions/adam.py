"""Adaptive gradient (Adam): every parameter has a step length of its own, and no curvature is needed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from massid.search.directions.direction import Makers
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

STEP_SIZE = 0.2
FORGET_MEAN, FORGET_SQUARE = 0.7, 0.9
_TINY = 1e-30


class AdamDirection:
    """-alpha scale m / sqrt(v), with running means m of the gradient and v of its square in units of the scales.

    Windows are few and long where Adam is at home in many small steps, so it forgets faster than is usual. The steps
    do not shrink by themselves near p*: the line search halves them.

    Args:
        step_size: alpha, as a fraction of the parameters' scales.
    """

    second_order: ClassVar[bool] = False

    def __init__(self, step_size: float = 0.0) -> None:
        self._step_size = step_size or STEP_SIZE
        self._mean: FloatArray | None = None
        self._square: FloatArray | None = None
        self._count = 0

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset along the normalised gradient."""
        gradient = space.scale * quadratic.gradient
        mean = np.zeros_like(gradient) if self._mean is None else self._mean
        square = np.zeros_like(gradient) if self._square is None else self._square
        self._count += 1
        self._mean = FORGET_MEAN * mean + (1.0 - FORGET_MEAN) * gradient
        self._square = FORGET_SQUARE * square + (1.0 - FORGET_SQUARE) * gradient**2
        unbiased_mean = self._mean / (1.0 - FORGET_MEAN**self._count)
        unbiased_square = self._square / (1.0 - FORGET_SQUARE**self._count)
        return -self._step_size * space.scale * unbiased_mean / np.sqrt(unbiased_square + _TINY)


MAKERS: Makers = {"adam": AdamDirection}
