"""What the log leaves uncertain: a covariance from curvature and scores, intervals from the covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic, inverse
from massid.typing import FloatArray

INTERVAL_95 = 1.959964
"""Half width of a 95 % interval in standard deviations."""
LARGEST_INFLATION = 2.0
"""Scatter of the windows' scores, relative to what noise explains, from which on the model is called wrong."""


def interval_95(value: float, std: float | None) -> list[float] | None:
    """Lower and upper end of the 95 % interval; None without a standard deviation."""
    return None if std is None else [value - INTERVAL_95 * std, value + INTERVAL_95 * std]


@dataclass(frozen=True)
class Posterior:
    """Uncertainty of an estimate.

    Attributes:
        covariance: of all parameters, in their units, shape (n_p, n_p).
        inflation: factor on the covariance by which the scores of the dwell windows scatter more than they should;
            1 when the noise is what it is said to be.
    """

    covariance: FloatArray
    inflation: float

    @property
    def std(self) -> FloatArray:
        """Standard deviations, shape (n_p,)."""
        return np.sqrt(np.diagonal(self.covariance))


class ScoreScatter:
    """How much more the scores of windows seen once scatter than their noise explains, in constant memory.

    A window's score at the estimate that it met has the covariance I_W + I_W I_B^-1 I_W: noise of its own, and what the
    belief B did not know. Scores count by what they do to the parameters asked for, once nuisances have made up for
    what they can.

    Args:
        asked: number of parameters that were asked for; they come first.
    """

    def __init__(self, asked: int) -> None:
        self._asked = asked
        self._found = self._expected = 0.0

    @property
    def inflation(self) -> float:
        """Factor on the covariance, at least 1."""
        return 1.0 if self._expected <= 0.0 else max(1.0, self._found / self._expected)

    def add(self, belief: LocalQuadratic, window: LocalQuadratic) -> None:
        """Take in a window, before it is added to the belief that it met."""
        known, own = inverse(0.5 * belief.curvature), 0.5 * window.curvature
        influence = inverse(0.5 * (belief + window).curvature)[: self._asked]
        effect = influence @ (0.5 * window.shifted(belief.centre - known @ (0.5 * belief.gradient)).gradient)
        expected = influence @ (own + own @ known @ own) @ influence.T
        self._found += float(effect @ np.linalg.solve(expected, effect))
        self._expected += self._asked


def posterior(
    space: ParameterSpace, total: LocalQuadratic, windows: Sequence[LocalQuadratic] = (), inflation: float = 1.0
) -> Posterior:
    """Combine the Hessian of -2 log-likelihood and the scatter of the windows' scores.

    Half the Hessian is the Fisher information if innovations are white. What the windows' scores do to the parameters
    asked for, with the nuisances profiled out, should then scatter by as much as the information says; what it scatters
    more inflates the covariance (the trace of the sandwich estimate).

    Args:
        space: what was unknown; the parameters asked for come first.
        total: sum over all windows and the prior, around the estimate; symmetric, see `LocalQuadratic.symmetric`.
        windows: each window's own part, without the prior; none if they were not kept.
        inflation: what is known of it otherwise, at least 1.
    """
    covariance = inverse(0.5 * total.curvature)
    asked = space.n_sampled
    if windows:
        influence = covariance[:asked]
        effects = np.array([influence @ (0.5 * window.shifted(total.centre).gradient) for window in windows])
        expected = sum(0.5 * influence @ window.curvature @ influence.T for window in windows)
        scatter = np.trace(np.linalg.solve(covariance[:asked, :asked], effects.T @ effects))
        share = np.trace(np.linalg.solve(covariance[:asked, :asked], expected))
        inflation = max(inflation, float(scatter / share))
    return Posterior(covariance=inflation * covariance, inflation=inflation)
