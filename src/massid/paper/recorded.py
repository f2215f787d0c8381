"""Recorded dwell windows of a system whose p* is known: what the checks of Section IV run models on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from massid.search.bank import Bank, Block
from massid.search.guided import GuidedSearch, Iteration, SearchOptions
from massid.search.monitoring import Monitoring
from massid.search.offline import BlockReplay, run_offline
from massid.search.online import WindowScorer
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

SAFE = SearchOptions(direction="safe-gradient", gradient="gram", candidates=0)
"""alpha_i = 1/L_i and nothing beside the centre: the theorems' minimal ModelSet."""


@dataclass(frozen=True)
class Check:
    """One statement of the paper and what came of it.

    Attributes:
        system: what it was checked on.
        name: where it stands in the paper.
        claim: what is claimed, or what was found instead.
        measured: numbers, in words.
        holds: whether the measurement agrees with the claim.
    """

    system: str
    name: str
    claim: str
    measured: str
    holds: bool


@dataclass(frozen=True)
class Recorded(Generic[Block]):
    """Dwell windows that can be replayed as often as it takes (Section IV-A), or one after the other (IV-B).

    Attributes:
        space: what is unknown, and the initial guess.
        truth: p*, shape (n_p,).
        blocks: the windows.
        make_bank: a bank of so many models.
        forgetting_rate: lambda of Eq. (6) [1/s].
        spacing: offsets of the models around a point along each axis, shape (n_p,).
    """

    space: ParameterSpace
    truth: FloatArray
    blocks: tuple[Block, ...]
    make_bank: Callable[[int], Bank[Block]]
    forgetting_rate: float
    spacing: FloatArray

    def only(self, *blocks: Block) -> Recorded[Block]:
        """The same with other windows."""
        return replace(self, blocks=blocks)

    def score(self, points: FloatArray) -> Monitoring:
        """Score models at any points over all windows; points has shape (n, n_p) and its first row is the centre."""
        proposal = Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * (len(points) - 1)))
        return BlockReplay(self.make_bank(len(points)), self.blocks, self.forgetting_rate).total(proposal)

    def quadratic(self, centre: FloatArray) -> LocalQuadratic:
        """Expand mu around a point, from antithetic samples along the axes."""
        offsets = np.vstack([np.diag(self.spacing), -np.diag(self.spacing)])
        return self.score(np.vstack([centre, centre + offsets])).local_quadratic()

    def information(self, centre: FloatArray | None = None) -> FloatArray:
        """Q of Eq. (13) at a point, by default p*, shape (n_p, n_p)."""
        return 0.5 * self.quadratic(self.truth if centre is None else centre).curvature

    def search(self, start: FloatArray, options: SearchOptions = SAFE, seed: int = 0) -> GuidedSearch:
        """A search from a point, with as few models as antithetic samples take."""
        return GuidedSearch(self.space, 2 * len(self.space) + 1, options, np.random.default_rng(seed), [start])

    def offline(self, start: FloatArray, passes: int, options: SearchOptions = SAFE) -> list[Iteration]:
        """Minimise the sum of mu over all windows."""
        replay = BlockReplay(self.make_bank(2 * len(self.space) + 1), self.blocks, self.forgetting_rate)
        return list(run_offline([replay], self.search(start, options), passes).iterations)

    def online(self, start: FloatArray, rounds: int = 1, options: SearchOptions = SAFE) -> list[Iteration]:
        """See one window after the other; in further rounds they come again."""
        search = self.search(start, options)
        scorer = WindowScorer(self.make_bank(2 * len(self.space) + 1), self.forgetting_rate)
        return [search.tell(scorer.score(search.ask(), block)) for _ in range(rounds) for block in self.blocks]

    def errors(self, start: FloatArray, iterations: list[Iteration]) -> FloatArray:
        """|p - p*| before and after each update, shape (1 + n,)."""
        points = np.vstack([start, *(iteration.estimate for iteration in iterations)])
        return np.asarray(np.linalg.norm(points - self.truth, axis=1))


@dataclass(frozen=True)
class OfflineRate:
    """Offline gradient descent with a fixed alpha.

    Attributes:
        gap: mu_k - mu(p*), shape (passes,).
        bound: right-hand side of Eq. (14), shape (passes,).
        error: |p_k - p*|, shape (passes,).
        steepest: what is left of the initial error in the direction of lambda_max(M), shape (passes,).
    """

    gap: FloatArray
    bound: FloatArray
    error: FloatArray
    steepest: FloatArray


def offline_rate(windows: Recorded[Block], passes: int, over: float = 1.0) -> OfflineRate:
    """Descend from the initial guess with alpha = over / L."""
    start, truth = windows.space.nominal, windows.truth
    eigenvalues, vectors = np.linalg.eigh(windows.quadratic(start).curvature)
    alpha = over / float(eigenvalues[-1])
    iterations = windows.offline(start, passes, replace(SAFE, step_size=alpha))
    estimates = np.array([iteration.estimate for iteration in iterations])
    mu = windows.score(np.vstack([truth, estimates])).mu
    k = np.arange(1, len(estimates) + 1)
    bound = float(np.sum((start - truth) ** 2)) / (2.0 * alpha * k)
    left = np.abs((estimates - truth) @ vectors[:, -1]) / abs(float((start - truth) @ vectors[:, -1]))
    return OfflineRate(
        np.asarray(mu[1:] - mu[0], dtype=np.float64),
        np.asarray(bound, dtype=np.float64),
        windows.errors(start, iterations)[1:],
        left,
    )


@dataclass(frozen=True)
class Growth:
    """How mu grows away from p*.

    Attributes:
        at_truth: mu(p*).
        least_ratio: the least mu(p) / |p - p*|^2 over points in random directions and along Q's eigenvectors.
        eigenvalue: the smallest eigenvalue of Q at p*.
    """

    at_truth: float
    least_ratio: float
    eigenvalue: float


def growth_of_mu(windows: Recorded[Block], farthest: float, points: int = 200) -> Growth:
    """Score points of Theta at random distances up to the farthest, in random directions and Q's eigenvectors."""
    rng = np.random.default_rng(0)
    eigenvalues, vectors = np.linalg.eigh(windows.information())
    directions = rng.normal(size=(points, len(windows.space)))
    directions[: 4 * len(vectors)] = np.tile(np.vstack([vectors.T, -vectors.T]), (2, 1))
    reach = farthest * rng.uniform(0.0005, 1.0, size=(points, 1))
    others = windows.truth + reach * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    others = windows.space.project(others)
    mu = windows.score(np.vstack([windows.truth, others])).mu
    ratio = mu[1:] / np.sum((others - windows.truth) ** 2, axis=1)
    return Growth(float(mu[0]), float(ratio.min()), float(eigenvalues[0]))


def order_of_change(windows: Recorded[Block], start: FloatArray) -> float:
    """The m of |mu(p + dp) - mu(p)| ~ |dp|^m for |dp| = 1e-1 .. 1e-6 in the direction of (1, .., 1)."""
    steps = 10.0 ** -np.arange(1, 7)
    direction = np.ones(len(start)) / np.sqrt(len(start))
    mu = windows.score(np.vstack([start, start + steps[:, None] * direction])).mu
    return float(np.polyfit(np.log(steps), np.log(np.abs(mu[1:] - mu[0])), 1)[0])
