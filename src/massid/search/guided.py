"""Guided multiple-model search (Algorithm 1) in ask/tell form: whoever asks simulates the models."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from massid.errors import BadInputError
from massid.ranges import OptionError, require_not_negative, require_positive
from massid.search.directions import Direction, direction_name, make_direction
from massid.search.directions.gauss_newton import GaussNewtonDirection
from massid.search.gradient import GradientEstimator, estimate_gradient
from massid.search.line_search import LineSearch
from massid.search.model_set import ModelSet
from massid.search.monitoring import Monitoring
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.search.quadratic import LocalQuadratic
from massid.search.sampling import Sampling, sample_locally
from massid.search.scan import choose_scanned, scan_points, scanned_columns
from massid.search.secant import Step, mixed
from massid.typing import FloatArray

LARGEST_MISS = 0.1
"""Share of what a model gained over the centre by which the quadratic may miss its score and still be trusted there."""


@dataclass(frozen=True)
class SearchOptions:
    """How to search.

    Attributes:
        direction: gauss-newton (second order, from the Gram matrix), gradient (the paper's), another by name, or one of
            your own.
        gradient: estimator of the gradient; default gram for second-order directions, ransac for the others.
        sampling: pairs (antithetic), ball or cube.
        radius: first sampling radius, as a fraction of the nominal values; it then follows the steps.
        smallest_radius: the radius never shrinks below this fraction.
        candidates: models of the line search that run beside the centre in the next window.
        kept: best models of a window that stay in the set for the next one, beside the line search's.
        scan: parameters whose values are taken from all over Theta in the first window.
        step_size: alpha of Eq. (9) for first-order directions; 0 takes it from the curvature.
        largest_step: no coordinate moves by more than this multiple of its scale in one update.
        step_tolerance: converged when the Newton step is below this fraction of every nominal value.
        gradient_tolerance: converged when the gradient of mu is below this number (Eq. 18); 0 switches it off.
        floor_share: converged when the Newton step would lower mu by less than this share of what it leaves: what is
            left is the log's own, and no parameters explain it. 0 switches it off.
    """

    direction: str | Direction = "gauss-newton"
    gradient: GradientEstimator | None = None
    sampling: Sampling = "pairs"
    radius: float = 0.1
    smallest_radius: float = 1e-3
    candidates: int = 3
    kept: int = 0
    scan: tuple[str, ...] = ()
    step_size: float = 0.0
    largest_step: float = np.inf
    step_tolerance: float = 1e-8
    gradient_tolerance: float = 0.0
    floor_share: float = 0.0

    def __post_init__(self) -> None:
        for name, value, known in (
            ("sampling", self.sampling, get_args(Sampling)),
            ("gradient", self.gradient, (None, *get_args(GradientEstimator))),
        ):
            if value not in known:
                raise BadInputError(f"`{name}` is {value!r}; expected one of {', '.join(filter(None, known))}.")
        require_positive({"radius": self.radius, "smallest_radius": self.smallest_radius})
        require_not_negative(
            {
                "candidates": self.candidates,
                "kept": self.kept,
                "step_size": self.step_size,
                "step_tolerance": self.step_tolerance,
                "gradient_tolerance": self.gradient_tolerance,
                "floor_share": self.floor_share,
            }
        )
        if not self.largest_step > 0:  # nan, too; inf is no cap
            raise OptionError("largest_step", self.largest_step, "above 0")


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
        BadInputError: too few models for the parameters, a guess outside Theta, or a scan of an unknown parameter.
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
        check_bank_size(space, n_models)
        self._rng = rng or np.random.default_rng(0)
        self._n_models = n_models
        starts = [np.asarray(guess, dtype=np.float64) for guess in guesses] or [space.nominal]
        for start in starts:
            if start.shape != space.nominal.shape or not space.contains(start):
                raise BadInputError(f"Initial guess {start} is not a point of Theta: {space.lower} .. {space.upper}.")
        self._radius = self.options.radius
        self._windows = 0
        self._estimate = starts[0]
        self._models = ModelSet(n_models, len(space.tangents))
        self._direction = make_direction(self.options.direction, self.options.step_size)
        self._line_search = LineSearch(self.options.largest_step)
        self._reach = 0.0  # of the last step, as a multiple of the scales
        self._from: FloatArray | None = None  # where it began
        self._stepped = False  # whether the last window ended with a step
        self._proposed: Step | None = None  # what the direction said last
        self._scanned = scanned_columns(space, self.options.scan)
        if len(self._scanned):
            self._fill_scan(starts)
        else:
            self._fill(starts[0], starts[1:])

    @property
    def estimate(self) -> FloatArray:
        """The current estimate p_updated, shape (n_p,)."""
        return self._estimate

    @property
    def radius(self) -> float:
        """Sampling radius of the points asked for, as a fraction of the scales."""
        return self._radius

    @property
    def n_candidates(self) -> int:
        """Candidates that fit beside the centre and enough samples."""
        wanted = self.options.candidates + self.options.kept
        return max(0, min(wanted, self._n_models - 1 - 2 * self.space.n_sampled))

    def ask(self, *, alone: bool = False) -> Proposal:
        """Points to simulate in the next window; the same until `tell` is called.

        Args:
            alone: nothing but the centre, for banks that supply derivatives by all coordinates themselves and windows
                whose slope is known from before; as always where the gradient is not the Gram matrix's.
        """
        if alone and self._estimator == "gram":
            return Proposal(self._estimate[None], (Role.CENTRE,), n_tangents=len(self.space))
        return self._models.proposal()

    @property
    def _estimator(self) -> GradientEstimator:
        return self.options.gradient or ("gram" if self._direction.second_order else "ransac")

    def restarted(self) -> GuidedSearch:
        """A new search from the estimate, for other measurements: candidates and step caps of this one mean nothing."""
        return self.moved_to(self.space, self._estimate)

    def moved_to(self, space: ParameterSpace, estimate: FloatArray) -> GuidedSearch:
        """A new search of another space, such as that of another walk's sensors, from a point of it."""
        options = replace(self.options, radius=max(self._radius, self.options.smallest_radius), scan=())
        return GuidedSearch(space, self._n_models, options, self._rng, [estimate])

    def tell(self, monitoring: Monitoring, *, again: bool = False) -> Iteration:
        """Learn from one window: select the best model, step, fill the model set anew.

        Args:
            monitoring: what the models asked for have scored.
            again: whether it is of the same measurements as in the last call, so that steps can be compared.

        Raises:
            DivergedBankError: too few models stayed finite.
        """
        options = self.options
        if len(self._scanned) and self._windows == 0:
            return self._tell_scan(monitoring)
        quadratic = monitoring.local_quadratic()
        if self._estimator != "gram":
            quadratic = replace(quadratic, gradient=estimate_gradient(monitoring, self._estimator, self._rng))
        best = self._models.select_best(monitoring)
        trusted = _is_trusted(quadratic, monitoring, best)
        self._line_search = self._judge_last_step(monitoring.proposal.points[best], trusted)
        quadratic = quadratic.shifted(monitoring.proposal.points[best])
        newton_step = GaussNewtonDirection().step(quadratic, self.space)
        step = np.zeros(len(self.space))
        if trusted:
            step = np.asarray(self._direction.step(quadratic, self.space), dtype=np.float64)
            if step.shape != quadratic.centre.shape or not np.isfinite(step).all():
                raise BadInputError(
                    f"Direction {direction_name(self.options.direction)} gave a step of shape {step.shape} that is "
                    f"{step}; expected {quadratic.centre.shape} finite numbers."
                )
            proposed = Step(quadratic.centre, step)
            if again and self._proposed is not None and self._direction.second_order:
                step = mixed(self._proposed, proposed, quadratic)
            self._proposed = proposed
            step = self._line_search.limit(quadratic.centre, step, self.space)
        self._from, self._stepped = quadratic.centre, trusted
        iteration = self._update(monitoring, best, quadratic, quadratic.centre + step, newton_step)
        candidates: list[FloatArray] = []
        if trusted:
            self._reach = float(np.max(np.abs(step) / self.space.scale))
            self._radius = float(np.clip(0.5 * self._reach, options.smallest_radius, options.radius))
            candidates = self._line_search.candidates(quadratic.centre, step, self.space)[: options.candidates]
        kept = self._models.select_kept(monitoring, options.kept, best)
        self._fill(self._estimate, [*candidates, *kept])
        return iteration

    def _judge_last_step(self, best: FloatArray, trusted: bool) -> LineSearch:
        """Narrow the step cap after a failure: the search went back to where it was, or its quadratic missed.

        Near p* noise may send a search back a hair's breadth, so second-order directions count only the latter.
        """
        went_back = self._from is not None and bool(np.array_equal(best, self._from))
        failed = not trusted if self._direction.second_order else went_back
        if failed:
            return self._line_search.narrowed(max(self._reach, self.options.smallest_radius))
        return self._line_search.widened(self.options.largest_step) if self._stepped else self._line_search

    def _tell_scan(self, monitoring: Monitoring) -> Iteration:
        """Go to the best of the scanned points; what led there runs beside it as candidates."""
        choice = choose_scanned(monitoring, self._scanned, self.space)
        quadratic = monitoring.local_quadratic()
        iteration = self._update(
            monitoring, choice.best, quadratic, choice.estimate, choice.estimate - quadratic.centre
        )
        points = monitoring.proposal.points
        self._stepped = True
        self._reach = float(np.max(np.abs(self._estimate - points[choice.best]) / self.space.scale))
        self._fill(self._estimate, [points[choice.best], points[self._models.select_best(monitoring)]])
        return iteration

    def _update(
        self,
        monitoring: Monitoring,
        best: int,
        quadratic: LocalQuadratic,
        estimate: FloatArray,
        newton_step: FloatArray,
    ) -> Iteration:
        """Move the estimate and write down why."""
        self._estimate = self.space.project(estimate)
        self._windows += 1
        return Iteration(
            index=self._windows - 1,
            monitoring=monitoring,
            best=best,
            quadratic=quadratic,
            estimate=self._estimate,
            newton_step=newton_step,
            radius=self._radius,
            status=self._status(quadratic, newton_step),
        )

    def _status(self, quadratic: LocalQuadratic, newton_step: FloatArray) -> SearchStatus:
        small_step = bool(np.all(np.abs(newton_step) <= self.options.step_tolerance * self.space.scale))
        small_gradient = float(np.linalg.norm(quadratic.gradient)) < self.options.gradient_tolerance
        gain = 0.5 * float(newton_step @ quadratic.curvature @ newton_step)
        at_floor = gain < self.options.floor_share * quadratic.at(quadratic.centre + newton_step)
        return SearchStatus.CONVERGED if small_step or small_gradient or at_floor else SearchStatus.RUNNING

    def _fill(self, centre: FloatArray, candidates: Sequence[FloatArray]) -> None:
        self._models.clear()
        self._models.insert_centre(centre)
        n_candidates = min(len(candidates), self.n_candidates)
        self._models.insert_candidates(candidates[:n_candidates])
        n_samples = self._n_models - 1 - n_candidates
        self._models.insert_samples(
            sample_locally(centre, n_samples, self._radius, self.space, self._rng, self.options.sampling)
        )

    def _fill_scan(self, starts: Sequence[FloatArray]) -> None:
        """The first window of a scan: the centre, one sample for each direction, everything else over Theta."""
        n_p = self.space.n_sampled
        self._models.insert_centre(starts[0])
        self._models.insert_samples(
            sample_locally(starts[0], n_p, self._radius, self.space, self._rng, self.options.sampling)
        )
        self._models.insert_candidates(starts[1:])
        rest = self._n_models - 1 - n_p - len(starts[1:])
        if rest < 1:
            raise BadInputError(
                f"A bank of {self._n_models} models leaves none to scan {', '.join(self.options.scan)} with: use at "
                f"least {n_p + 1 + len(starts)} models."
            )
        self._models.insert_candidates(list(scan_points(self.space, starts[0], self._scanned, rest)))


def enough_models(n_unknowns: int) -> int:
    """Models with which a search goes well: centre, candidates, and three samples for each unknown."""
    return 3 * n_unknowns + 3


def check_bank_size(space: ParameterSpace, n_models: int) -> None:
    """Pass if a bank has a model for the centre and one for each unknown.

    Raises:
        BadInputError: it has fewer.
    """
    n_p = space.n_sampled
    if n_models < n_p + 1:
        raise BadInputError(
            f"A bank of {n_models} models serves at most {n_models - 1} unknowns, but {n_p} are asked for: "
            f"use at least {n_p + 1} models, better {enough_models(n_p)}."
        )


def _is_trusted(quadratic: LocalQuadratic, monitoring: Monitoring, best: int) -> bool:
    """Whether the samples' quadratic reaches as far as p_best: it may miss the score there by a tenth of the gain.

    Guesses and kept models may lie far from the samples; from such a one the search takes no step, but samples there.
    """
    if best == monitoring.proposal.centre:
        return True
    gained = float(monitoring.mu[monitoring.proposal.centre] - monitoring.mu[best])
    return abs(quadratic.at(monitoring.proposal.points[best]) - float(monitoring.mu[best])) <= LARGEST_MISS * gained
