"""The paper's direction: the negative gradient of mu (Section III, step 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, TypeAlias

from massid.search.directions.direction import Makers
from massid.search.directions.metric import Metric, exact_step_size, largest_curvature, metric_weight
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

StepRule: TypeAlias = Literal["exact", "lipschitz"]
"""exact: to the minimum of the local quadratic along the gradient; lipschitz: alpha = 1/L, the bound of Theorem 1."""


@dataclass(frozen=True)
class GradientDirection:
    """-grad mu, with the step length that the bank's own curvature gives, or a fixed one.

    Attributes:
        metric: see `Metric`. With masses in kilograms the Hessian's condition is an order of magnitude worse than in
            units of the scales.
        step_size: alpha of Eq. (9); 0 for what the rule says.
        rule: see `StepRule`.
    """

    metric: Metric = "scale"
    step_size: float = 0.0
    rule: StepRule = "exact"

    second_order: ClassVar[bool] = False

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset along the negative gradient."""
        weight = metric_weight(space, self.metric)
        direction = -weight * quadratic.gradient
        if self.step_size:
            return self.step_size * direction
        if self.rule == "exact":
            return exact_step_size(quadratic, direction) * direction
        bound = largest_curvature(quadratic, weight)
        return direction / bound if bound > 0.0 else 0.0 * direction


MAKERS: Makers = {
    "gradient": lambda step_size: GradientDirection("scale", step_size),
    "plain-gradient": lambda step_size: GradientDirection("unit", step_size),
    "safe-gradient": lambda step_size: GradientDirection("unit", step_size, "lipschitz"),
}
