"""BFGS: curvature learnt from gradients of successive windows, none of it from the Gram matrix."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from massid.search.directions.direction import Makers
from massid.search.directions.metric import Metric, exact_step_size, metric_weight
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

LEAST_CURVATURE = 1e-8


class BfgsDirection:
    """-B grad mu, with the inverse Hessian B updated from each window's change of point and gradient.

    mu is another function in every window, so a pair of differences may not belong to any quadratic; pairs without
    positive curvature are left out. The first step is the exact one along the gradient.

    Args:
        metric: see `Metric`; of the first step.
    """

    second_order: ClassVar[bool] = False

    def __init__(self, metric: Metric = "scale") -> None:
        self._metric: Metric = metric
        self._inverse: FloatArray | None = None
        self._last: LocalQuadratic | None = None

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset along the quasi-Newton direction."""
        if self._last is not None:
            self._learn(quadratic.centre - self._last.centre, quadratic.gradient - self._last.gradient, space)
        self._last = quadratic
        if self._inverse is None:
            direction = -metric_weight(space, self._metric) * quadratic.gradient
            return exact_step_size(quadratic, direction) * direction
        return -self._inverse @ quadratic.gradient

    def _learn(self, move: FloatArray, change: FloatArray, space: ParameterSpace) -> None:
        along = float(move @ change)
        if along <= LEAST_CURVATURE * float(np.linalg.norm(move) * np.linalg.norm(change)) or along == 0.0:
            return
        if self._inverse is None:
            weight = metric_weight(space, self._metric)
            self._inverse = np.diag(weight) * along / float(change @ (weight * change))
        left = np.eye(len(move)) - np.outer(move, change) / along
        self._inverse = left @ self._inverse @ left.T + np.outer(move, move) / along


MAKERS: Makers = {"bfgs": lambda step_size: BfgsDirection("scale")}
