"""The line search (Section III, step 3): how far along a direction, and what is tried beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray

BORDER_DAMPING = 0.7
"""beta of Section III: the factor that shortens a step until it ends inside Theta."""

FAILED_SHARE = 0.25
"""Cap after a failed step, as a share of it; a good step widens the cap by the inverse."""

_MOST_DISCOUNTS = 60
_NUDGE = 1e-9


@dataclass(frozen=True)
class LineSearch:
    """Turns a direction's step into the next estimate and its candidates.

    Scores of different windows cannot be compared, so a step is judged in the window after it: where it came from, half
    of it and twice of it run beside it as candidates, and the best of all is where the search goes on.

    Attributes:
        largest_step: no coordinate moves by more than this multiple of its scale in one update.
    """

    largest_step: float = np.inf

    def narrowed(self, failed_reach: float) -> LineSearch:
        """After a step of this reach went astray: a quarter of it is the cap."""
        return LineSearch(FAILED_SHARE * failed_reach)

    def widened(self, largest_step: float) -> LineSearch:
        """After a step that went well: a wider cap again, at most this one."""
        return LineSearch(min(largest_step, self.largest_step / FAILED_SHARE))

    def limit(self, centre: FloatArray, step: FloatArray, space: ParameterSpace) -> FloatArray:
        """Shorten a step to the cap, then by beta until it ends in Theta; zero if it never does.

        A step that leads to the border and no further passes unchanged. What leads out of Theta from its border is
        dropped first, or a minimum on the border would never be reached.
        """
        nudged = centre + _NUDGE * np.sign(step) * space.scale
        step = np.where(space.project(nudged) == nudged, step, 0.0)
        reach = float(np.max(np.abs(step) / space.scale))
        if reach > self.largest_step:
            step = self.largest_step / reach * step
        for _ in range(_MOST_DISCOUNTS):
            if _ends_inside(centre + step, space):
                return step
            step = BORDER_DAMPING * step
        return np.zeros_like(step)

    def candidates(self, centre: FloatArray, step: FloatArray, space: ParameterSpace) -> list[FloatArray]:
        """Points to simulate beside the new estimate: no step, half a step, twice the step."""
        return [space.project(point) for point in (centre, centre + 0.5 * step, centre + 2.0 * step)]


def _ends_inside(point: FloatArray, space: ParameterSpace) -> bool:
    """Whether a point lies in Theta, rounding aside."""
    return bool(np.all(np.abs(space.project(point) - point) <= 1e-12 * space.scale))
