"""Gradient with momentum (Polyak's heavy ball)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from massid.search.directions.direction import Makers
from massid.search.directions.metric import Metric, largest_curvature, metric_weight
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

MOMENTUM = 0.7


class HeavyBallDirection:
    """-alpha grad mu + MOMENTUM (p_i - p_{i-1}), with alpha = 1/L of the window unless it is given.

    p_i - p_{i-1} is what the line search made of the last step: a step that was taken back leaves no momentum.

    Args:
        metric: see `Metric`.
        step_size: alpha; 0 for 1/L.
    """

    second_order: ClassVar[bool] = False

    def __init__(self, metric: Metric = "scale", step_size: float = 0.0) -> None:
        self._metric: Metric = metric
        self._step_size = step_size
        self._last: FloatArray | None = None

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset along gradient and momentum."""
        weight = metric_weight(space, self._metric)
        bound = largest_curvature(quadratic, weight)
        alpha = self._step_size or (1.0 / bound if bound > 0.0 else 0.0)
        momentum = np.zeros(len(space)) if self._last is None else quadratic.centre - self._last
        self._last = quadratic.centre
        return MOMENTUM * momentum - alpha * weight * quadratic.gradient


MAKERS: Makers = {"heavy-ball": lambda step_size: HeavyBallDirection("scale", step_size)}
