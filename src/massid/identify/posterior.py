"""What the log leaves uncertain: a covariance from curvature and scores, intervals from the covariance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

INTERVAL_95 = 1.959964
"""Half width of a 95 % interval in standard deviations."""


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
    belief B did not know. Scores are taken for the parameters asked for, once nuisances have made up for what they can.

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
        before, own = 0.5 * belief.curvature, 0.5 * window.curvature
        centre = belief.centre - _inverse(before) @ (0.5 * belief.gradient)
        profile = _efficient(_inverse(before + own), self._asked)
        score = 0.5 * profile @ window.shifted(centre).gradient
        expected = profile @ (own + own @ _inverse(before) @ own) @ profile.T
        self._found += float(score @ np.linalg.solve(expected, score))
        self._expected += self._asked


def _inverse(information: FloatArray) -> FloatArray:
    """Pseudo-inverse of an information matrix, whose diagonal is positive, in units in which that diagonal is 1."""
    scale = np.sqrt(np.diagonal(information))
    return np.asarray(np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale))


def _efficient(covariance: FloatArray, asked: int) -> FloatArray:
    """Maps a score of all parameters to that of those asked for, with nuisances profiled out, shape (asked, n_p)."""
    own, cross = covariance[:asked, :asked], covariance[:asked, asked:]
    return np.hstack([np.eye(asked), np.linalg.solve(own, cross)])


def posterior(
    space: ParameterSpace, total: LocalQuadratic, windows: Sequence[LocalQuadratic] = (), inflation: float = 1.0
) -> Posterior:
    """Combine the Hessian of -2 log-likelihood and the scatter of the windows' scores.

    Half the Hessian is the Fisher information if innovations are white. The windows' scores for the parameters asked
    for, with the nuisances profiled out, should then scatter by as much as the information says; what they scatter
    more inflates the covariance (the trace of the sandwich estimate).

    Args:
        space: what was unknown; the parameters asked for come first.
        total: sum over all windows and the prior, around the estimate.
        windows: each window's own part, without the prior; none if they were not kept.
        inflation: what is known of it otherwise, at least 1.
    """
    inverse = _inverse(0.5 * total.curvature)
    asked = space.n_sampled
    if windows:
        effective = np.linalg.inv(inverse[:asked, :asked])
        profile = _efficient(inverse, asked)
        scores = np.array([0.5 * profile @ window.shifted(total.centre).gradient for window in windows])
        expected = sum(0.5 * profile @ window.curvature @ profile.T for window in windows)
        scatter = np.trace(np.linalg.solve(effective, scores.T @ scores))
        inflation = max(inflation, float(scatter / np.trace(np.linalg.solve(effective, expected))))
    return Posterior(covariance=inflation * inverse, inflation=inflation)
