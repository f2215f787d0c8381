"""Section V-C: dynamic sampling, the model re-distribution that the paper compares with (its reference [11]).

A grid of models covers a box, at first Theta. After every dwell window the box is centred at the best model and made
smaller by the zoom factor; it never leaves Theta. The number of models is exponential in the number of unknowns.
"""

from __future__ import annotations

import numpy as np

from massid.errors import BadInputError
from massid.search.guided import Iteration
from massid.search.monitoring import Monitoring
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.typing import FloatArray


class DynamicSampling:
    """Asks for a grid, is told its scores, and zooms in on the best.

    Args:
        space: the unknowns and Theta.
        per_axis: models along each axis; the paper has 4, so 64 for three unknowns.
        zoom: width of the next box as a fraction of this one's, 0 < zoom < 1.
        start: the estimate before the first window; default the nominal values. It does not move the grid.

    Raises:
        BadInputError: a zoom factor that does not zoom in, or fewer than two models to an axis.
    """

    def __init__(
        self, space: ParameterSpace, per_axis: int = 4, zoom: float = 0.8, start: FloatArray | None = None
    ) -> None:
        if not 0.0 < zoom < 1.0:
            raise BadInputError(f"zoom is {zoom}; it must lie between 0 and 1.")
        if per_axis < 2:
            raise BadInputError(f"per_axis is {per_axis}; a grid needs at least 2 models to an axis.")
        self.space = space
        self._zoom = zoom
        self._estimate = space.nominal if start is None else start
        self._lower, self._upper = space.lower, space.upper
        middles = (np.arange(per_axis) + 0.5) / per_axis
        axes = np.meshgrid(*[middles] * len(space), indexing="ij")
        self._cells = np.stack([axis.ravel() for axis in axes], axis=1)

    @property
    def n_models(self) -> int:
        """Size of the grid."""
        return len(self._cells)

    @property
    def estimate(self) -> FloatArray:
        """The best model of the last window, shape (n_p,)."""
        return self._estimate

    @property
    def width(self) -> FloatArray:
        """Width of the box, shape (n_p,)."""
        return self._upper - self._lower

    def ask(self) -> Proposal:
        """The middles of the box's cells; they are all candidates, and the first one stands in for a centre."""
        points = self._lower + self._cells * self.width
        return Proposal(points=points, roles=(Role.CENTRE, *[Role.CANDIDATE] * (len(points) - 1)))

    def tell(self, monitoring: Monitoring) -> Iteration | None:
        """Zoom in on the best model; there is no quadratic to report."""
        best = monitoring.proposal.points[int(np.argmin(monitoring.mu))]
        width = self._zoom * self.width
        lower = np.clip(best - 0.5 * width, self.space.lower, self.space.upper - width)
        self._lower, self._upper = lower, lower + width
        self._estimate = best
        return None
