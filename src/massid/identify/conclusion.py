"""From the end of a search to a Result: everything put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from massid.identify.findings import Findings
from massid.identify.inference import Inference
from massid.model.robot import Robot
from massid.result.quantities import describe, whole_shapes
from massid.result.result import Result, Status, WindowResult
from massid.search.parameters import ParameterSpace


@dataclass(frozen=True)
class LogFacts:
    """What a result says about its logs.

    Attributes:
        mode: "online" or "offline".
        log_s: time covered [s].
        timestep_s: longest sample period [s].
        sources: names of the logs.
    """

    mode: str
    log_s: float
    timestep_s: float
    sources: tuple[str, ...]


def conclude(
    robot: Robot,
    findings: Findings,
    inference: Inference,
    trace: Sequence[WindowResult],
    settled: bool,
    log: LogFacts,
    wall_s: float,
) -> Result:
    """Judge a search and put everything together."""
    asked = findings.space.n_sampled
    space = ParameterSpace(findings.space.parameters[:asked])
    found = inference.assess(findings, trace, log.timestep_s, settled)
    identifiable = whole_shapes(space, found.excitation.identifiable)
    status = Status.CONVERGED if found.settled else Status.NOT_CONVERGED
    if found.settled and found.contradicted:
        status = Status.CONTRADICTED
    if not identifiable.all():
        status = Status.NOT_IDENTIFIABLE
    covariance = None if found.uncertainty is None else found.uncertainty.covariance
    return Result(
        space=space,
        estimate=findings.estimate[:asked],
        status=status,
        windows=tuple(trace),
        excitation=replace(found.excitation, identifiable=identifiable),
        mode=log.mode,
        log_s=log.log_s,
        wall_s=wall_s,
        warnings=found.warnings,
        sources=log.sources,
        uncertainty=found.uncertainty,
        quantities=describe(robot, space, findings.estimate[:asked], covariance, identifiable),
    )
