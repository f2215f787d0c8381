"""The metric in which a gradient is taken: the paper's is that of the parameters' own units."""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

Metric: TypeAlias = Literal["scale", "unit"]
"""scale: parameters in units of their scales, so that a kilogram counts for more on a foot than on a torso;
unit: as they are. The paper does not say which."""


def metric_weight(space: ParameterSpace, metric: Metric) -> FloatArray:
    """Factor that turns a gradient into the direction of steepest ascent in the metric, shape (n_p,)."""
    return space.scale**2 if metric == "scale" else np.ones(len(space))


def exact_step_size(quadratic: LocalQuadratic, direction: FloatArray) -> float:
    """Step alpha that minimises the quadratic along a direction, alpha = -g^T d / (d^T H d); 0 without curvature.

    Along the negative gradient it is at least 1/L, the bound of Theorem 1.
    """
    along = float(direction @ quadratic.curvature @ direction)
    return -float(quadratic.gradient @ direction) / along if along > 0.0 else 0.0


def largest_curvature(quadratic: LocalQuadratic, weight: FloatArray) -> float:
    """L of Eq. (12) in the metric of a weight: the largest eigenvalue of W^1/2 H W^1/2."""
    root = np.sqrt(weight)
    return float(np.linalg.eigvalsh(quadratic.curvature * np.outer(root, root))[-1])
