"""Search directions: from a local quadratic to the step that the line search begins with (Section III, step 2).

One direction, one file, one interface: `Direction.step`. A direction may remember earlier windows, so every search
makes its own.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol, TypeAlias

from massid.search.directions.adam import AdamDirection
from massid.search.directions.bfgs import BfgsDirection
from massid.search.directions.box import box_minimum
from massid.search.directions.gauss_newton import GaussNewtonDirection
from massid.search.directions.gradient import GradientDirection
from massid.search.directions.heavy_ball import HeavyBallDirection
from massid.search.directions.levenberg_marquardt import LevenbergMarquardtDirection
from massid.search.directions.metric import Metric
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

__all__ = [
    "DIRECTIONS",
    "SECOND_ORDER",
    "AdamDirection",
    "BfgsDirection",
    "Direction",
    "DirectionName",
    "GaussNewtonDirection",
    "GradientDirection",
    "HeavyBallDirection",
    "LevenbergMarquardtDirection",
    "Metric",
    "box_minimum",
]

DirectionName: TypeAlias = Literal[
    "gauss-newton", "levenberg-marquardt", "gradient", "plain-gradient", "safe-gradient", "heavy-ball", "adam", "bfgs"
]


class Direction(Protocol):
    """Computes alpha times the search direction: the offset of the next estimate (Eq. 9)."""

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset from the quadratic's centre, shape (n_p,); the line search keeps it in Theta."""


DIRECTIONS: dict[DirectionName, Callable[[float], Direction]] = {
    "gauss-newton": lambda step_size: GaussNewtonDirection(),
    "levenberg-marquardt": lambda step_size: LevenbergMarquardtDirection(),
    "gradient": lambda step_size: GradientDirection("scale", step_size),
    "plain-gradient": lambda step_size: GradientDirection("unit", step_size),
    "safe-gradient": lambda step_size: GradientDirection("unit", step_size, "lipschitz"),
    "heavy-ball": lambda step_size: HeavyBallDirection("scale", step_size),
    "adam": AdamDirection,
    "bfgs": lambda step_size: BfgsDirection("scale"),
}
"""Makes a direction from alpha of Eq. (9), 0 for its own choice; second-order directions need none."""

SECOND_ORDER: frozenset[DirectionName] = frozenset({"gauss-newton", "levenberg-marquardt"})
"""Directions that take curvature and gradient from the Gram matrix."""
