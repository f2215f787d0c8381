"""The ModelSet of Algorithm 1: what is simulated in the next window, and which of it is best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massid.search.monitoring import Monitoring
from massid.search.proposal import Proposal, Role
from massid.typing import FloatArray


class ModelSet:
    """Points with their roles, at most `capacity` of them.

    Inferior models are discarded at every update (Algorithm 1, line 9): the set is cleared and keeps, of the window
    before, what the line search asks to see again as a candidate, and as many of the best models as it is told to.

    Args:
        capacity: size of the bank.
        n_tangents: coordinates, the last ones, that samples do not spread in.
    """

    def __init__(self, capacity: int, n_tangents: int = 0) -> None:
        self._capacity = capacity
        self._n_tangents = n_tangents
        self._points: list[FloatArray] = []
        self._roles: list[Role] = []

    def clear(self) -> None:
        """Discard all models."""
        self._points.clear()
        self._roles.clear()

    def insert_centre(self, point: FloatArray) -> None:
        """Insert the current estimate; it comes first."""
        self._points.insert(0, point)
        self._roles.insert(0, Role.CENTRE)

    def insert_candidates(self, points: Sequence[FloatArray]) -> None:
        """Insert points of the line search, or additional initial guesses."""
        for point in points:
            self._insert(point, Role.CANDIDATE)

    def insert_samples(self, points: FloatArray) -> None:
        """Insert local samples, shape (n, n_p)."""
        for point in points:
            self._insert(point, Role.SAMPLE)

    def proposal(self) -> Proposal:
        """All models as one array with their roles."""
        return Proposal(points=np.array(self._points), roles=tuple(self._roles), n_tangents=self._n_tangents)

    @staticmethod
    def select_best(monitoring: Monitoring) -> int:
        """Row of the model with the least mu among centre and candidates (p_best)."""
        rows = np.concatenate([[monitoring.proposal.centre], monitoring.proposal.candidates])
        return int(rows[np.argmin(monitoring.mu[rows])])

    @staticmethod
    def select_kept(monitoring: Monitoring, count: int, best: int) -> FloatArray:
        """Points of the models with the least mu, whatever their role, the best one aside; at most count of them."""
        ranked = [row for row in np.argsort(monitoring.mu) if row != best and not monitoring.diverged[row]]
        return monitoring.proposal.points[ranked[:count]]

    def _insert(self, point: FloatArray, role: Role) -> None:
        if len(self._points) < self._capacity:
            self._points.append(point)
            self._roles.append(role)
