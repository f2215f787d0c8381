"""Guided multiple-model search (Algorithm 1) in ask/tell form: whoever asks simulates the models."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from massid.errors import BadInputError
from massid.parameters import ParameterSpace
from massid.search.directions import DIRECTIONS, DirectionName
from massid.search.gradient import GradientEstimator, estimate_gradient
from massid.search.model_set import ModelSet
from massid.search.monitoring import Monitoring
from massid.search.proposal import Proposal
from massid.search.quadratic import LocalQuadratic
from massid.search.sampling import Sampling, sample_locally
from massid.typing import FloatArray


@dataclass(frozen=True)
class SearchOptions:
    """How to search.

    Attributes:
        direction: gauss-newton (second order, from the Gram matrix) or gradient (the paper's).
        gradient: estimator of the gradient; default gram for gauss-newton, ransac for gradient.
        sampling: pairs (antithetic), ball or cube.
        radius: first sampling radius, as a fraction of the nominal values; it then follows the steps.
        smallest_radius: the radius never shrinks below this fraction.
        candidates: models of the line search that run beside the centre in the next window.
        step_tolerance: converged when the Newton step is below this fraction of every nominal value.
        gradient_tolerance: converged when |grad mu| is below this number (Eq. 18); 0 switches it off.
    """

    direction: DirectionName = "gauss-newton"
    gradient: GradientEstimator | None = None
    sampling: Sampling = "pairs"
    radius: float = 0.1
    smallest_radius: float = 1e-3
    candidates: int = 3
    step_tolerance: float = 1e-8
    gradient_tolerance: float = 0.0


class SearchStatus(enum.StrEnum):
    """Where the search stands."""

    RUNNING = "running"
    CONVERGED = "converged"


@dataclass(frozen=True)
class Iteration:
    """What one window taught.

    Attributes:
        index: number of the window, from 0.
        monitoring: points, roles and scores of all models.
        best: row of the best of centre and candidates, the p_best of Algorithm 1.
        quadratic: mu around p_best.
        estimate: p_updated, shape (n_p,).
        newton_step: offset from p_best to the minimum of the quadratic in Theta, shape (n_p,).
        radius: sampling radius of the window.
        status: whether a termination condition holds.
    """

    index: int
    monitoring: Monitoring
    best: int
    quadratic: LocalQuadratic
    estimate: FloatArray
    newton_step: FloatArray
    radius: float
    status: SearchStatus

    @property
    def mu(self) -> float:
        """Score of p_best."""
        return float(self.monitoring.mu[self.best])


class GuidedSearch:
    """The search for p*: ask for points, simulate them for one dwell window, tell their scores.

    Args:
        space: what is unknown, and Theta.
        n_models: size of the bank, at least n_p + 1.
        options: how to search.
        rng: source of randomness; the same seed gives the same search.
        guesses: initial guesses, the first of which gets the local samples; default the nominal values.

    Raises:
        BadInputError: too few models for the parameters, or a guess outside Theta.
    """

    def __init__(
        self,
        space: ParameterSpace,
        n_models: int,
        options: SearchOptions | None = None,
        rng: np.random.Generator | None = None,
        guesses: Sequence[FloatArray] = (),
    ) -> None:
        self.space = space
        self.options = options or SearchOptions()
        if n_models < len(space) + 1:
            raise BadInputError(
                f"A bank of {n_models} models serves at most {n_models - 1} unknowns, but {len(space)} are asked for: "
                f"use at least {len(space) + 1} models, better {3 * len(space) + 3}."
            )
        self._rng = rng or np.random.default_rng(0)
        self._n_models = n_models
        starts = [np.asarray(guess, dtype=np.float64) for guess in guesses] or [space.nominal]
        for start in starts:
            if start.shape != space.nominal.shape or not space.contains(start):
                raise BadInputError(f"Initial guess {start} is not a point of Theta: {space.lower} .. {space.upper}.")
        self._radius = self.options.radius
        self._windows = 0
        self._estimate = starts[0]
        self._models = ModelSet(n_models)
        self._fill(starts[0], starts[1:])

    @property
    def estimate(self) -> FloatArray:
        """The current estimate p_updated, shape (n_p,)."""
        return self._estimate

    @property
    def n_candidates(self) -> int:
        """Candidates that fit beside the centre and enough samples."""
        return max(0, min(self.options.candidates, self._n_models - 1 - 2 * len(self.space)))

    def ask(self) -> Proposal:
        """Points to simulate in the next window; the same until `tell` is called."""
        return self._models.proposal()

    def tell(self, monitoring: Monitoring) -> Iteration:
        """Learn from one window: select the best model, step, fill the model set anew.

        Raises:
            DivergedBankError: too few models stayed finite.
        """
        options = self.options
        quadratic = monitoring.local_quadratic()
        direction = options.direction
        estimator = options.gradient or ("gram" if direction == "gauss-newton" else "ransac")
        if estimator != "gram":
            quadratic = replace(quadratic, gradient=estimate_gradient(monitoring, estimator, self._rng))
        best = self._models.select_best(monitoring)
        quadratic = quadratic.shifted(monitoring.proposal.points[best])
        step = DIRECTIONS[direction].step(quadratic, self.space)
        newton_step = DIRECTIONS["gauss-newton"].step(quadratic, self.space)
        self._estimate = self.space.project(quadratic.centre + step)
        iteration = Iteration(
            index=self._windows,
            monitoring=monitoring,
            best=best,
            quadratic=quadratic,
            estimate=self._estimate,
            newton_step=newton_step,
            radius=self._radius,
            status=self._status(quadratic, newton_step),
        )
        self._windows += 1
        reach = float(np.max(np.abs(step) / self.space.scale))
        self._radius = float(np.clip(0.5 * reach, options.smallest_radius, options.radius))
        line = [quadratic.centre, quadratic.centre + 0.5 * step, quadratic.centre + 2.0 * step]
        self._fill(self._estimate, [self.space.project(point) for point in line])
        return iteration

    def _status(self, quadratic: LocalQuadratic, newton_step: FloatArray) -> SearchStatus:
        small_step = bool(np.all(np.abs(newton_step) <= self.options.step_tolerance * self.space.scale))
        small_gradient = float(np.linalg.norm(quadratic.gradient)) < self.options.gradient_tolerance
        return SearchStatus.CONVERGED if small_step or small_gradient else SearchStatus.RUNNING

    def _fill(self, centre: FloatArray, candidates: Sequence[FloatArray]) -> None:
        self._models.clear()
        self._models.insert_centre(centre)
        n_candidates = min(len(candidates), self.n_candidates)
        self._models.insert_candidates(candidates[:n_candidates])
        n_samples = self._n_models - 1 - n_candidates
        self._models.insert_samples(
            sample_locally(centre, n_samples, self._radius, self.space, self._rng, self.options.sampling)
        )
