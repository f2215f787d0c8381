"""Inference from readings without error: mu as in the paper, solved to rounding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massid.identify.findings import Assessment, Findings
from massid.identify.options import IdentifyOptions
from massid.model.robot import Robot
from massid.result.excitation import assess_excitation
from massid.result.result import WindowResult
from massid.search.guided import Iteration, SearchOptions, SearchStatus
from massid.search.monitoring import Monitoring
from massid.search.offline import UntilConverged
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray
from massid.walk import Walk

STREAM_FLOOR, REPLAY_FLOOR = 0.2, 1e-6
"""A step that would lower mu by less than this share of what it leaves is within what the log itself leaves open. Of a
stream each window has errors of its own, correlated for as long as the injection takes, of which a few parameters
explain some percent; a log that is replayed has the same in every pass."""
SETTLED_STEP = 1e-5
"""A log that ends while steps move no parameter by more than this share of its scale has been solved that well, whether
or not there was a further window to show it."""
LARGEST_REST = 1e-3
"""Share of the links' masses that may stay unexplained."""
MARGIN = 10.0
"""Factor on the part of mu that the curvature of the output error in the masses explains."""


class ExactInference:
    """Nothing but what is sampled is unknown, and the windows' Hessians tell what the log reveals of it."""

    def unknowns(self, asked: ParameterSpace, robot: Robot, walk: Walk, options: IdentifyOptions) -> ParameterSpace:
        """The parameters asked for, without nuisances that a user may have brought."""
        return ParameterSpace(asked.parameters[: asked.n_sampled])

    def search_options(self, options: SearchOptions, *, replayed: bool) -> SearchOptions:
        """With an end at the log's own floor: engines solve contacts to a tolerance, and logs are rounded."""
        return replace(options, floor_share=options.floor_share or (REPLAY_FLOOR if replayed else STREAM_FLOOR))

    def prior(self, space: ParameterSpace) -> LocalQuadratic | None:
        """None."""
        return None

    def pass_rule(self, space: ParameterSpace, *, near: bool = False) -> UntilConverged:
        """All windows, until the search has converged."""
        return UntilConverged()

    def learning(self, space: ParameterSpace, options: IdentifyOptions, timestep_s: float) -> ExactLearning:
        """Hessians of all windows."""
        return ExactLearning(space, timestep_s)

    def deviations(self, space: ParameterSpace, quadratic: LocalQuadratic, inflation: float) -> None:
        """None."""

    def assess(self, findings: Findings, trace: Sequence[WindowResult], timestep_s: float, settled: bool) -> Assessment:
        """Judge the sum of the windows' Hessians, the last step and what is left of mu."""
        space = findings.space
        settled = settled or bool(np.all(np.abs(trace[-1].newton_step) <= SETTLED_STEP * space.scale))
        excitation = assess_excitation(space, findings.information.curvature, timestep_s)
        rest = relative_rest(space, findings.estimate, findings.last)
        if rest < LARGEST_REST:
            return Assessment(excitation, None, settled, ())
        warning = (
            f"these links' masses do not explain the log: what is left weighs as much as an error of {rest:.2%} in "
            "each of them. Links that were not named (`links`), the model or the log are off, and so are the masses "
            f"found{'.' if settled else '; or the search has not settled yet.'}"
        )
        return Assessment(excitation, None, settled, (warning,), contradicted=True)


class ExactLearning:
    """Windows that are judged on their own; their Hessians add up.

    Args:
        space: what is unknown.
        timestep_s: sample period [s].
    """

    def __init__(self, space: ParameterSpace, timestep_s: float) -> None:
        self._space, self._timestep_s = space, timestep_s
        self.belief: LocalQuadratic | None = None
        self.information = LocalQuadratic.belief(space.nominal, np.zeros(len(space)))
        self.last = self.information
        self.starts_anew = True
        self.converged = self.settled = False
        self.inflation = 1.0

    def learn(self, monitoring: Monitoring, iteration: Iteration) -> None:
        """Add a window's Hessian."""
        self.last = monitoring.window_quadratic()
        self.information = self.information + self.last
        is_explained = relative_rest(self._space, iteration.estimate, self.last) < LARGEST_REST
        self.settled = is_explained and iteration.status is SearchStatus.CONVERGED
        # Windows in which a link hardly moves solve for it, too, and show nothing of it: later ones may.
        self.converged = self.settled and self._all_known()

    def _all_known(self) -> bool:
        """Whether the windows so far reveal everything that was asked for."""
        return bool(assess_excitation(self._space, self.information.curvature, self._timestep_s).identifiable.all())

    def next_walk(self, before: ParameterSpace, space: ParameterSpace) -> bool:
        """A border is a gap and nothing else."""
        return False


def relative_rest(space: ParameterSpace, estimate: FloatArray, last: LocalQuadratic) -> float:
    """What no masses of the links asked for explain of a log.

    What is left of mu is stated as the relative error that a typical one of these masses would have to have to leave as
    much. Rounding leaves 1e-13; a search that is still far off leaves what the samples show to be curved, which is
    taken off; where they show nothing but that, as with a solver that stops early, masses do not explain the log.

    Args:
        space: what is unknown.
        estimate: shape (n_p,).
        last: the last window's quadratic, or that of all windows.
    """
    change = last.change(estimate - last.centre, space.n_sampled)
    curved = last.misfit * (change / max(last.explained, np.finfo(float).tiny)) ** 2
    is_affine = last.misfit < last.explained
    left = max(0.0, last.at(estimate) - (MARGIN * curved if is_affine else 0.0))
    effect = 0.5 * np.diagonal(last.curvature) * space.scale**2
    return float(np.sqrt(left / max(float(effect.mean()), np.finfo(float).tiny)))
