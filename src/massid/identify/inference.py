"""From scores to an answer: what the search is run by, when it ends, and what is known at the end.

Logs without error and logs with sensor noise differ in all of it, so each sensor model has an inference of its own
(`exact`, `likelihood`). This is the only place where the one is told from the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from massid.identify.exact import ExactInference
from massid.identify.findings import Assessment, Findings, Learning
from massid.identify.likelihood import LikelihoodInference
from massid.identify.options import IdentifyOptions
from massid.model.robot import Robot
from massid.observer.sensors import ExactSensors, SensorModel
from massid.result.result import WindowResult
from massid.search.guided import SearchOptions
from massid.search.offline import PassRule
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray
from massid.walk import Walk


class Inference(Protocol):
    """How logs with sensors of one kind are identified."""

    def unknowns(self, asked: ParameterSpace, robot: Robot, walk: Walk, options: IdentifyOptions) -> ParameterSpace:
        """The parameters asked for, followed by what else is unknown about a walk."""

    def search_options(self, options: SearchOptions, *, replayed: bool) -> SearchOptions:
        """How to search a stream, or a log that is replayed."""

    def prior(self, space: ParameterSpace) -> LocalQuadratic | None:
        """What is believed beforehand, in units of mu; None for nothing."""

    def pass_rule(self, space: ParameterSpace, *, near: bool = False) -> PassRule:
        """When passes over a log have taught what there is to learn.

        Args:
            space: what is unknown.
            near: whether the search starts near its end, so that all of the log is needed at once.
        """

    def learning(self, space: ParameterSpace, options: IdentifyOptions, timestep_s: float) -> Learning:
        """What windows of a stream add up to.

        Raises:
            BadInputError: the direction does not suit a stream with such sensors.
        """

    def deviations(self, space: ParameterSpace, quadratic: LocalQuadratic, inflation: float) -> FloatArray | None:
        """Standard deviations of the parameters asked for at a pass, shape (n_asked,); None where noise leaves none.

        Args:
            space: what is unknown.
            quadratic: mu around the estimate, prior included.
            inflation: by which scores were found to scatter more than noise explains.
        """

    def assess(self, findings: Findings, trace: Sequence[WindowResult], timestep_s: float, settled: bool) -> Assessment:
        """How certain the end of a search is."""


def inference_for(sensors: SensorModel) -> Inference:
    """The inference that goes with a sensor model."""
    return ExactInference() if isinstance(sensors, ExactSensors) else LikelihoodInference(sensors)
