"""mu along a direction of the masses, from one replay of a log by models that are placed on lines through a point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from massid.observer.bank import RobotBank
from massid.search.monitoring import MonitoringFilter
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.typing import FloatArray
from massid.walk import Walk

STEPS = (-0.2, -0.1, -0.05, 0.05, 0.1, 0.2)
"""Where models are placed along a direction, in relative masses."""


@dataclass(frozen=True)
class Curve:
    """How mu rises along a direction, from where it starts.

    Attributes:
        held: all else held, shape (n_steps,).
        settled: nuisances and the masses across the direction having settled where they fit best, shape (n_steps,);
            None where the models have no derivatives by them.
    """

    held: FloatArray
    settled: FloatArray | None

    @property
    def std(self) -> float | None:
        """Standard deviation that the curvature of the settled curve stands for; None without such a curve."""
        if self.settled is None:
            return None
        curvature = float(np.polyfit(STEPS, self.settled, 2)[0])
        return curvature**-0.5 if curvature > 0.0 else np.inf


def n_models(directions: int) -> int:
    """Size of the bank that so many directions take."""
    return 1 + directions * len(STEPS)


def mu_along(
    walk: Walk, bank: RobotBank, space: ParameterSpace, start: FloatArray, directions: Sequence[FloatArray]
) -> list[Curve]:
    """Replay a log and sum mu over all of it.

    Args:
        walk: the log, aligned with the robot.
        bank: `n_models` models.
        space: masses that were asked for, then nuisances.
        start: a point of that space, shape (n_p,).
        directions: unit vectors in relative masses, shape (n_asked,) each.
    """
    asked = len(directions[0])
    points = np.repeat(start[None], n_models(len(directions)), axis=0)
    offsets = np.vstack([np.outer(STEPS, direction) for direction in directions])
    points[1:, :asked] += offsets * space.scale[:asked]
    gram = _replay(walk, bank, points)
    mu = np.diagonal(gram)[: len(points)]
    curves = []
    for rows, direction in zip(np.arange(1, len(points)).reshape(len(directions), -1), directions, strict=True):
        settled = None
        if len(gram) > len(points):
            least = settled_mu(gram, len(points), space, direction)
            settled = least[rows] - least[0]
        curves.append(Curve(mu[rows] - mu[0], settled))
    return curves


def _replay(walk: Walk, bank: RobotBank, points: FloatArray) -> FloatArray:
    """Gram matrix of all models' output errors and their derivatives over the whole log."""
    scores = MonitoringFilter(bank.n_models, bank.timestep_s)  # all of the log counts: nothing is forgotten
    bank.place(points)
    for segment in walk.segments:
        for _, errors in bank.replay(walk, segment):
            scores.update(errors)
    proposal = Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * (len(points) - 1)))
    return scores.result(proposal).gram


def settled_mu(gram: FloatArray, n: int, space: ParameterSpace, direction: FloatArray) -> FloatArray:
    """Least mu of each model over all that is not along a direction, shape (n,).

    With B the derivatives of the output error y and P the priors, min over b of |y + B b|^2 + b^T P b is
    |y|^2 - y^T B (B^T B + P)^-1 B^T y.

    Args:
        gram: of the output errors of n models, followed by their derivatives by all coordinates of the space.
        n: number of models.
        space: masses that were asked for, then nuisances.
        direction: unit vector in relative masses, shape (n_asked,).
    """
    asked = len(direction)
    basis = np.zeros((len(space), len(space) - 1))
    basis[:asked, : asked - 1] = space.scale[:asked, None] * null_space(direction[None])
    basis[asked:, asked - 1 :] = np.diag(space.scale[asked:])
    information = basis.T @ (gram[n:, n:] + np.diag(space.prior_precision)) @ basis
    slope = gram[:n, n:] @ basis
    settling = np.einsum("ij,ji->i", slope, np.linalg.solve(information, slope.T))
    return np.asarray(np.diagonal(gram)[:n] - settling)
