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


def posterior(space: ParameterSpace, total: LocalQuadratic, windows: Sequence[LocalQuadratic] = ()) -> Posterior:
    """Combine the Hessian of -2 log-likelihood and the scatter of the windows' scores.

    Half the Hessian is the Fisher information if innovations are white. The windows' scores for the parameters asked
    for, with the nuisances profiled out, should then scatter by as much as the information says; what they scatter
    more inflates the covariance (the trace of the sandwich estimate).

    Args:
        space: what was unknown; the parameters asked for come first.
        total: sum over all windows and the prior, around the estimate.
        windows: each window's own part, without the prior; none for no inflation.
    """
    information = 0.5 * total.curvature
    scale = np.sqrt(np.diagonal(information))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
    asked = space.n_sampled
    weights = -inverse[:asked, asked:]
    effective = np.linalg.inv(inverse[:asked, :asked])
    # Efficient scores: what a window says about the asked ones, once nuisances have made up for what they can.
    profile = np.hstack([np.eye(asked), np.linalg.solve(inverse[:asked, :asked], -weights)])
    inflation = 1.0
    if windows:
        scores = np.array([0.5 * profile @ window.shifted(total.centre).gradient for window in windows])
        expected = sum(0.5 * profile @ window.curvature @ profile.T for window in windows)
        scatter = np.trace(np.linalg.solve(effective, scores.T @ scores))
        inflation = max(1.0, float(scatter / np.trace(np.linalg.solve(effective, expected))))
    return Posterior(covariance=inflation * inverse, inflation=inflation)
