"""From the end of a search to a Result: status, verdict and, for a noisy log, uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from massid.identify.excitation import assess_excitation, from_deviations
from massid.identify.posterior import posterior
from massid.identify.result import Result, Status, Uncertainty, WindowResult
from massid.noise import SensorNoise
from massid.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray


@dataclass(frozen=True)
class Findings:
    """What a search ended with.

    Attributes:
        space: what was unknown, nuisances included.
        estimate: shape (n_p,).
        information: sum of what all windows and the prior say.
        windows: each window's own part, if it was kept.
        noise: sensor noise; None for a log without noise.
        chi2_per_sample: mean square of the last whitened innovations of the centre.
    """

    space: ParameterSpace
    estimate: FloatArray
    information: LocalQuadratic
    windows: tuple[LocalQuadratic, ...]
    noise: SensorNoise | None
    chi2_per_sample: float


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
    findings: Findings, trace: Sequence[WindowResult], converged: bool, log: LogFacts, wall_s: float
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
        # On a noisy log every window moves the estimate; it has settled when it moves within its own uncertainty.
        step = trace[-1].newton_step
        converged = float(step @ np.linalg.solve(uncertainty.covariance, step)) <= len(space)
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
        warnings=log.warnings + _caveats(findings.noise, log.mode),
        sources=log.sources,
        uncertainty=uncertainty,
    )


def _caveats(noise: SensorNoise | None, mode: str) -> tuple[str, ...]:
    if noise is None or mode == "offline" or not (noise.effort_offset or noise.effort_gain or noise.force_offset):
        return ()
    return (
        "sensors with unknown offsets and gains: the online intervals are too narrow by a factor of several; "
        "use --mode offline for intervals to rely on.",
    )


def _uncertainty(findings: Findings, noise: SensorNoise) -> Uncertainty:
    asked = findings.space.n_sampled
    found = posterior(findings.space, findings.information, findings.windows)
    return Uncertainty(
        noise=noise,
        covariance=found.covariance[:asked, :asked],
        inflation=found.inflation,
        chi2_per_sample=findings.chi2_per_sample,
        nuisances=findings.space.tangents,
        nuisance_estimate=findings.estimate[asked:],
        nuisance_std=found.std[asked:],
    )
