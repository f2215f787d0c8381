"""The paper's direction: the negative gradient of mu (Section III, step 2)."""

from __future__ import annotations

from dataclasses import dataclass

from massid.parameters import ParameterSpace
from massid.search.directions.metric import Metric, exact_step_size, metric_weight
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray


@dataclass(frozen=True)
class GradientDirection:
    """-grad mu, with the step length that the bank's own curvature gives, or a fixed one.

    Attributes:
        metric: see `Metric`. With masses in kilograms the Hessian's condition is an order of magnitude worse than in
            units of the scales.
        step_size: alpha of Eq. (9); 0 for the exact minimiser of the local quadratic along the gradient.
    """

    metric: Metric = "scale"
    step_size: float = 0.0

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset along the negative gradient."""
        direction = -metric_weight(space, self.metric) * quadratic.gradient
        return (self.step_size or exact_step_size(quadratic, direction)) * direction
