"""From the end of a search to a Result: status, verdict and, for a noisy log, uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from massid.model.robot import Robot
from massid.model.unknowns.unknown import adds_mass, unknowns_of
from massid.result.excitation import assess_excitation, from_deviations
from massid.result.posterior import LARGEST_INFLATION, posterior
from massid.result.quantities import describe, whole_shapes
from massid.result.result import Result, Status, Uncertainty, WindowResult
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray
from massid.walk.noise import SensorNoise

LARGEST_REST = 1e-3
"""Share of the links' masses that may stay unexplained in a log without noise."""
MARGIN = 10.0
"""Factor on the part of mu that the curvature of the output error in the masses explains."""


@dataclass(frozen=True)
class Findings:
    """What a search ended with.

    Attributes:
        space: what was unknown, nuisances included.
        estimate: shape (n_p,).
        information: sum of what all windows and the prior say.
        windows: each window's own part, if it was kept.
        noise: sensor noise; None for a log without noise.
        last: the last window's quadratic, or that of the last pass over all windows, without the prior.
        inflation: how much more the scores of windows that were not kept scatter than noise explains.
    """

    space: ParameterSpace
    estimate: FloatArray
    information: LocalQuadratic
    windows: tuple[LocalQuadratic, ...]
    noise: SensorNoise | None
    last: LocalQuadratic
    inflation: float = 1.0


@dataclass(frozen=True)
class LogFacts:
    """What a result says about its logs.

    Attributes:
        mode: "online" or "offline".
        log_s: time covered [s].
        timestep_s: longest sample period [s].
        sources: names of the logs.
        warnings: what the user should know, one line each.
    """

    mode: str
    log_s: float
    timestep_s: float
    sources: tuple[str, ...]
    warnings: tuple[str, ...]


def conclude(
    robot: Robot, findings: Findings, trace: Sequence[WindowResult], converged: bool, log: LogFacts, wall_s: float
) -> Result:
    """Judge a search and put everything together."""
    asked = findings.space.n_sampled
    space = ParameterSpace(findings.space.parameters[:asked])
    uncertainty = None
    if findings.noise is None:
        curvature = findings.information.curvature[:asked, :asked]
        excitation = assess_excitation(space, curvature, log.timestep_s)
    else:
        uncertainty = _uncertainty(findings, findings.noise)
        excitation = from_deviations(space, uncertainty.std)
        # A noisy log has also settled when the estimate moves within its own uncertainty.
        step = trace[-1].newton_step
        converged = converged or float(step @ np.linalg.solve(uncertainty.covariance, step)) <= len(space)
    excitation = replace(excitation, identifiable=whole_shapes(space, excitation.identifiable))
    status = Status.CONVERGED if converged else Status.NOT_CONVERGED
    if not excitation.identifiable.all():
        status = Status.NOT_IDENTIFIABLE
    return Result(
        space=space,
        estimate=findings.estimate[:asked],
        status=status,
        windows=tuple(trace),
        excitation=excitation,
        mode=log.mode,
        log_s=log.log_s,
        wall_s=wall_s,
        warnings=log.warnings + _misfit(findings, converged) + _scatter(uncertainty),
        sources=log.sources,
        uncertainty=uncertainty,
        quantities=describe(
            robot,
            space,
            findings.estimate[:asked],
            None if uncertainty is None else uncertainty.covariance,
            excitation.identifiable,
        ),
    )


def _scatter(uncertainty: Uncertainty | None) -> tuple[str, ...]:
    """Say so if a noisy log is explained no better than a wrong model would."""
    if uncertainty is None or uncertainty.inflation < LARGEST_INFLATION:
        return ()
    return (
        f"the log's windows contradict each other {uncertainty.inflation:.3g} times more than sensor noise explains: "
        "the model is off (friction, centres of mass, inertias), or the noise is not what it is taken for. The "
        "intervals were widened for it, but a bias that all windows share is not in them.",
    )


def _misfit(findings: Findings, converged: bool) -> tuple[str, ...]:
    """Say so if no masses of the links asked for explain a log without noise.

    What is left of mu is stated as the relative error that a typical one of these masses would have to have to leave as
    much. Rounding leaves 1e-13; a search that is still far off leaves what the samples show to be curved.
    """
    if findings.noise is not None:
        return ()
    last = findings.last
    change = last.change(findings.estimate - last.centre, findings.space.n_sampled)
    curved = last.misfit * (change / max(last.explained, np.finfo(float).tiny)) ** 2
    left = max(0.0, last.at(findings.estimate) - MARGIN * curved)
    effect = 0.5 * np.diagonal(findings.last.curvature) * findings.space.scale**2
    relative = float(np.sqrt(left / max(float(effect.mean()), np.finfo(float).tiny)))
    if relative < LARGEST_REST:
        return ()
    return (
        f"these links' masses do not explain the log: what is left weighs as much as an error of {relative:.2%} in "
        "each of them. Links that were not named (--links), the model or the log are off, and so are the masses found"
        + ("." if converged else "; or the search has not settled, and a longer walk helps."),
    )


def _uncertainty(findings: Findings, noise: SensorNoise) -> Uncertainty:
    asked = findings.space.n_sampled
    found = posterior(findings.space, findings.information, findings.windows, findings.inflation)
    masses = adds_mass(findings.space)
    return Uncertainty(
        noise=noise,
        covariance=found.covariance[:asked, :asked],
        inflation=found.inflation,
        chi2_per_sample=findings.last.value / findings.last.samples,
        total_std_kg=float(np.sqrt(masses @ found.covariance @ masses)),
        nuisances=unknowns_of(findings.space)[asked:],
        nuisance_estimate=findings.estimate[asked:],
        nuisance_std=found.std[asked:],
    )
