"""What the search asks for: N points of Theta, and what each of them is for.

How the models are split, for N models and n_p parameters:

- one centre, always model 0: the current estimate;
- up to n_c candidates (3 by default, fewer when models are scarce): other points of the line search, simulated in the
  same window as the centre, since scores of different windows cannot be compared; in the first window they are the
  additional initial guesses;
- all others are samples around the centre: antithetic pairs while there are enough of them.

24 models and 7 unknown masses give 1 + 3 + 20. At least n_p samples are needed, so N models serve N - 1 parameters.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from massid.typing import FloatArray, IntArray


class Role(enum.StrEnum):
    """What a model of the bank is for."""

    CENTRE = "centre"
    CANDIDATE = "candidate"
    SAMPLE = "sample"


@dataclass(frozen=True)
class Proposal:
    """Points to be simulated in the next window.

    Attributes:
        points: shape (n_models, n_p); row 0 is the centre.
        roles: one per row.
        n_tangents: coordinates, the last ones, that the samples do not spread in.
    """

    points: FloatArray
    roles: tuple[Role, ...]
    n_tangents: int = 0

    @property
    def n_sampled(self) -> int:
        """Coordinates that the samples spread in, the first ones."""
        return int(self.points.shape[1]) - self.n_tangents

    def of(self, columns: IntArray) -> Proposal:
        """The same points with some of their coordinates, all those that samples spread in among them."""
        return Proposal(self.points[:, columns], self.roles, len(columns) - self.n_sampled)

    @property
    def centre(self) -> int:
        """Row of the centre."""
        return 0

    @cached_property
    def candidates(self) -> IntArray:
        """Rows of the line search's candidates and of additional initial guesses."""
        return self._rows(Role.CANDIDATE)

    @cached_property
    def samples(self) -> IntArray:
        """Rows of the samples around the centre."""
        return self._rows(Role.SAMPLE)

    def _rows(self, role: Role) -> IntArray:
        return np.asarray([i for i, found in enumerate(self.roles) if found is role], dtype=np.int64)
