"""Inference from noisy readings: mu is minus twice the log-likelihood, half its Hessian the information."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from massid.errors import BadInputError
from massid.identify.findings import Assessment, Findings
from massid.identify.hypotheses import Hypothesis, hypotheses
from massid.identify.logs import hand_over
from massid.identify.options import IdentifyOptions
from massid.identify.sensing import with_nuisances
from massid.model.robot import Robot
from massid.model.unknowns.unknown import adds_mass, unknowns_of
from massid.observer.sensors import NoisySensors
from massid.result.excitation import from_deviations
from massid.result.posterior import LARGEST_INFLATION, ScoreScatter, posterior
from massid.result.result import Uncertainty, WindowResult
from massid.search.directions import direction_name, direction_names, make_direction
from massid.search.guided import Iteration, SearchOptions, SearchStatus
from massid.search.monitoring import Monitoring
from massid.search.offline import Outlook
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray
from massid.walk import Walk

SETTLED_DECREASE = 0.02
"""A log is solved when what is left beyond the last step would lower -2 log-likelihood by less: the root of the score
is then a seventh of a standard deviation away."""
STALLED_PASSES, STALLED_SHARE = 3, 0.7
"""So many passes in a row that each leave more than this share of what was to be gained end the search: the log reveals
too little. Of a walk a tenth is left."""
WELL = 0.25
"""A pass that leaves less than this share of what was to be gained has halved the distance: steps converge."""
FIRST_WINDOWS = 4
"""A log is replayed no further than that until the estimate is about as good as so many windows can make it."""
NEAR = 0.1
"""A step by less than this share of every mass asked for ends so near the root that the slope seen there serves again:
derivatives change by about as much, and as much of the distance is left after a further step."""
ALTERNATIVES = 3
"""Further errors that might explain a log are named up to so many."""
NEAR_ENOUGH = 0.3
"""Root mean square of the last step, in standard deviations, below which a search that ended otherwise has settled."""
LARGEST_RISE = 0.01
"""A search whose last pass explains the log worse than an earlier one by more than this share runs away. Where it comes
to rest, the share is 0.002 and less: innovations of models that are off do not quite meet at the lowest mu."""
LARGEST_BEND = 1.0
"""Beyond it a window of a stream has taught where to look next, and no more."""


class LikelihoodInference:
    """Sensors' slow errors and doubts about the model are unknowns with priors; windows are sums of one likelihood.

    Args:
        sensors: with their noise.
    """

    def __init__(self, sensors: NoisySensors) -> None:
        self._noise, self._scales = sensors.noise, sensors.scales

    def unknowns(self, asked: ParameterSpace, robot: Robot, walk: Walk, options: IdentifyOptions) -> ParameterSpace:
        """The parameters asked for, followed by nuisances."""
        return with_nuisances(asked, robot, walk, self._noise, options)

    def search_options(self, options: SearchOptions, *, replayed: bool) -> SearchOptions:
        """Without candidates: a model that is too heavy answers less to the noise in its inputs, and scores better."""
        return replace(options, candidates=0)

    def prior(self, space: ParameterSpace) -> LocalQuadratic:
        """Of the nuisances, and of the whole robot's mass if it was weighed."""
        belief = LocalQuadratic.belief(space.nominal, space.prior_precision)
        return belief if self._scales is None else belief + self._scales.belief(space)

    def pass_rule(self, space: ParameterSpace, *, near: bool = False) -> LikelihoodPasses:
        """A few windows first, unless the search starts near its end; then all, until nothing is gained."""
        return LikelihoodPasses(space, None if near else FIRST_WINDOWS)

    def learning(self, space: ParameterSpace, options: IdentifyOptions, timestep_s: float) -> LikelihoodLearning:
        """A running belief.

        Raises:
            BadInputError: a first-order direction, which does not reach the minimum in one pass.
        """
        if not make_direction(options.search.direction).second_order:
            named = direction_name(options.search.direction)
            second_order = [name for name in direction_names() if make_direction(name).second_order]
            raise BadInputError(
                f"Direction {named} does not reach the minimum in one pass over a noisy log, and intervals are those "
                f"of the minimum: choose one of {', '.join(second_order)}, or offline identification."
            )
        return LikelihoodLearning(space, self.prior(space))

    def deviations(self, space: ParameterSpace, quadratic: LocalQuadratic, inflation: float) -> FloatArray:
        """From the curvature of mu."""
        return posterior(space, quadratic, inflation=inflation).std[: space.n_sampled]

    def assess(self, findings: Findings, trace: Sequence[WindowResult], timestep_s: float, settled: bool) -> Assessment:
        """Deviations from curvature and scores; an estimate that moves well within its own uncertainty has settled.

        Not so if passes have made it worse: many small steps in one direction lead anywhere.
        """
        asked = findings.space.n_sampled
        space = ParameterSpace(findings.space.parameters[:asked])
        uncertainty, covariance = self._uncertainty(findings)
        step = trace[-1].newton_step
        distance = float(np.sqrt(step @ np.linalg.solve(uncertainty.covariance, step) / len(space)))
        settled = settled or distance < NEAR_ENOUGH
        guesses = hypotheses(findings.space, findings.estimate, covariance, uncertainty.inflation)
        warnings = (
            _scatter(uncertainty, settled) + _runaway(uncertainty, findings.rise) + _denied(findings.space, guesses)
        )
        if not settled:
            uncertainty = replace(uncertainty, covariance=uncertainty.covariance + np.outer(step, step))
            warnings += _restless(space, step, distance)
        return Assessment(
            from_deviations(space, uncertainty.std),
            uncertainty,
            settled and findings.rise < LARGEST_RISE,
            warnings,
            contradicted=bool(guesses) or uncertainty.inflation >= LARGEST_INFLATION,
        )

    def _uncertainty(self, findings: Findings) -> tuple[Uncertainty, FloatArray]:
        """Of what was asked for; and the covariance of everything, not inflated."""
        asked = findings.space.n_sampled
        found = posterior(findings.space, findings.information, findings.windows, findings.inflation)
        masses = adds_mass(findings.space)
        uncertainty = Uncertainty(
            noise=self._noise,
            covariance=found.covariance[:asked, :asked],
            inflation=found.inflation,
            chi2_per_sample=findings.last.at(findings.estimate) / findings.last.samples,
            total_std_kg=float(np.sqrt(masses @ found.covariance @ masses)),
            nuisances=unknowns_of(findings.space)[asked:],
            nuisance_estimate=findings.estimate[asked:],
            nuisance_std=found.std[asked:],
        )
        return uncertainty, found.covariance / found.inflation


def _scatter(uncertainty: Uncertainty, settled: bool) -> tuple[str, ...]:
    """Say so if a log is explained no better than a wrong model would."""
    if uncertainty.inflation < LARGEST_INFLATION:
        return ()
    return (
        f"the log's windows contradict each other {uncertainty.inflation:.3g} times more than sensor noise explains: "
        f"{'' if settled else 'the search has not come to rest, '}"
        "the model is off (friction, centres of mass, inertias), or the noise is not what it is taken for. The "
        "intervals were widened for it, but a bias that all windows share is not in them.",
    )


def _denied(space: ParameterSpace, guesses: Sequence[Hypothesis]) -> tuple[str, ...]:
    """Say what the log asks for that was believed to be impossible: the surest, and what else would do."""
    if not guesses:
        return ()
    others = ", ".join(one.name for one in guesses[1 : 1 + ALTERNATIVES])
    return (guesses[0].text(space) + (f" Less likely: {others}." if others else ""),)


def _restless(space: ParameterSpace, step: FloatArray, distance: float) -> tuple[str, ...]:
    """Say how far the search still was from where it was going."""
    worst = int(np.argmax(np.abs(step) / space.scale))
    return (
        f"the search has not come to rest: its last step still goes {distance:.2g} standard deviations on (root mean "
        f"square; {space.names[worst]} by {step[worst]:+.2g}). The intervals were widened by it. More `passes` go on, "
        "unless they ended because they no longer gained anything; then the log reveals too little of what was asked.",
    )


def _runaway(uncertainty: Uncertainty, rise: float) -> tuple[str, ...]:
    """Say so if later passes explain the log worse than earlier ones."""
    if rise < LARGEST_RISE:
        return ()
    found = zip(uncertainty.nuisances, uncertainty.nuisance_estimate.tolist(), strict=True)
    worst = sorted(found, key=lambda one: -abs(one[1] - one[0].nominal) / (one[0].prior_std or np.inf))[:3]
    named = ", ".join(f"{one.name} to {value:.3g} {one.unit}".removesuffix(" 1") for one, value in worst)
    return (
        f"the last pass explains the log {rise:.1%} worse than the best one did: the masses run away, and with them "
        f"what was not asked for (farthest from what is believed: {named or 'nothing'}). Their intervals do not hold. "
        "Say what is known of the sensors: `lag_s=0` if all channels share a clock, `noise` if an instrument is better "
        "than assumed.",
    )


class LikelihoodPasses:
    """Ends passes over a log by what further ones would gain.

    Args:
        space: what is unknown; what was asked for comes first.
        first_windows: how many are replayed until these have taught what they can; None for all from the start.
    """

    def __init__(self, space: ParameterSpace, first_windows: int | None = FIRST_WINDOWS) -> None:
        self.first_windows = first_windows
        self._asked, self._scale = space.n_sampled, space.scale[: space.n_sampled]
        self._gains: list[float] = []

    def judge(self, iteration: Iteration, sees_all: bool) -> Outlook:
        """Settled when little is left to gain; stalled when passes do not lower what is."""
        left = _decrease_left(iteration, self._asked)
        self._gains.append(left)
        stalled = _is_stalled(self._gains)
        if not sees_all:
            if stalled or _left_to_come(self._gains) < self._asked:
                self._gains.clear()
                return Outlook.WIDEN
            return Outlook.GO_ON
        if iteration.status is SearchStatus.CONVERGED or _left_to_come(self._gains) < SETTLED_DECREASE:
            return Outlook.SETTLED
        if stalled:
            return Outlook.STALLED
        shrinks = len(self._gains) < 2 or self._gains[-1] < WELL * self._gains[-2]
        is_near = np.all(np.abs(iteration.newton_step[: self._asked]) < NEAR * self._scale)
        return Outlook.NEAR if is_near and shrinks else Outlook.GO_ON


def _left_to_come(gains: Sequence[float]) -> float:
    """What all steps after the last one would still gain, if each is to the one before as the last two are.

    Steps that shrink by a factor r end r / (1 - r) of the last one away; gains shrink by its square. Nothing is
    foretold of a single step, or of one that is not clearly shorter than the one before.
    """
    if len(gains) < 2 or gains[-1] > WELL * gains[-2]:
        return gains[-1]
    ratio = float(np.sqrt(gains[-1] / gains[-2]))
    return gains[-1] * (ratio / (1.0 - ratio)) ** 2


def _decrease_left(iteration: Iteration, asked: int) -> float:
    """By how much the Newton step lowers mu over the parameters asked for, nuisances wherever they fit best."""
    step = iteration.newton_step[:asked]
    return 0.5 * float(step @ iteration.quadratic.marginal(np.arange(asked)).curvature @ step)


def _is_stalled(gains: Sequence[float]) -> bool:
    """Whether passes no longer lower what is to be gained by further ones."""
    last = gains[-STALLED_PASSES - 1 :]
    return len(last) > STALLED_PASSES and all(after > STALLED_SHARE * before for before, after in pairwise(last))


class LikelihoodLearning:
    """A belief that windows, each seen once, are added to as far as their quadratics reach.

    Args:
        space: what is unknown.
        prior: belief about it.
    """

    def __init__(self, space: ParameterSpace, prior: LocalQuadratic) -> None:
        self._space = space
        self._scatter = ScoreScatter(space.n_sampled)
        self._is_rough = True
        self.belief = self.information = self.last = prior
        self.starts_anew = True
        self.converged = False

    @property
    def settled(self) -> bool:
        """Whether the last window was near enough to be believed."""
        return not self._is_rough

    @property
    def inflation(self) -> float:
        """How much more the scores of windows scatter than noise explains."""
        return self._scatter.inflation

    def learn(self, monitoring: Monitoring, iteration: Iteration) -> FloatArray:
        """Add a window to the belief, the less the further the estimate has moved from where it was seen."""
        window = self.last = monitoring.window_quadratic()
        found = posterior(self._space, self.belief + window)
        bend = _bend(window, iteration.estimate, found.covariance, self._space)
        if not self._is_rough and bend <= LARGEST_BEND:
            self._scatter.add(self.belief, window)
        # Too far for the models to start the next window where they would stand there.
        self.starts_anew = self._is_rough = bend > LARGEST_BEND
        self.information = self.belief = self.belief + window.scaled(1.0 / (1.0 + bend))
        found = posterior(self._space, self.belief, inflation=self.inflation)
        return found.std[: self._space.n_sampled]

    def next_walk(self, before: ParameterSpace, space: ParameterSpace) -> bool:
        """Keep what is known of the masses; sensors begin anew."""
        self._space = space
        self.information = self.belief = hand_over(self.belief, before, space)
        return True


def _bend(window: LocalQuadratic, estimate: FloatArray, covariance: FloatArray, space: ParameterSpace) -> float:
    """Variance by which a window's quadratic may mislead at an estimate, in units of the noise's variance.

    Dynamics are rational functions of the masses: where a mass moves by a fraction rho of itself, derivatives of the
    output error by it, and by the errors of sensors, change by about rho. So does what was explained with them.

    Args:
        window: quadratic of one dwell window, around its own centre.
        estimate: where the search went, shape (n_p,).
        covariance: how uncertain that is, shape (n_p, n_p).
        space: what is unknown.
    """
    sampled, tangents = slice(space.n_sampled), slice(space.n_sampled, None)
    offset = estimate - window.centre
    squared = np.outer(offset, offset) + covariance
    explained = 0.5 * window.curvature * squared
    fraction = np.diagonal(squared)[sampled] / space.scale[sampled] ** 2
    return float(fraction @ np.diagonal(explained)[sampled] + fraction.max() * explained[tangents, tangents].sum())
