"""What a search direction is, and where the ones that come with massid are found by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias

from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray


class Direction(Protocol):
    """Computes alpha times the search direction: the offset of the next estimate (Eq. 9).

    A direction may remember earlier windows, so every search makes, or copies, its own. One of a user's own is handed
    in as an object (`SearchOptions(direction=...)`).
    """

    @property
    def second_order(self) -> bool:
        """Whether it goes by the Gram matrix's curvature and gradient, and so to the minimum of what a window shows."""

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        """Offset from the quadratic's centre, shape (n_p,); the line search keeps it in Theta."""


Makers: TypeAlias = dict[str, Callable[[float], Direction]]
"""By name, what makes a direction from alpha of Eq. (9), 0 for its own choice; second-order directions need none."""
