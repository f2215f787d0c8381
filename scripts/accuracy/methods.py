"""The methods that are compared, each from a prepared walk to a dictionary of plain numbers."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import chi2

from accuracy.case import Case, Method
from accuracy.sysid import weigh_by_chunks, weigh_by_observer
from accuracy.walks import Given
from massid import IdentifyOptions, weigh
from massid.compare import cramer_rao, scan_cutoffs, self_chosen
from massid.identify.sensing import with_nuisances
from massid.observer.blas import single_threaded
from massid.result.posterior import INTERVAL_95
from massid.result.result import Result
from massid.search.parameters import ParameterSpace
from massid.walk import Walk
from massid.walk.noise import PRESETS

Measure = Callable[[Case, Given, int], dict[str, Any]]
"""From a prepared walk and a number of threads to plain numbers."""


def measure(case: Case, given: Given, threads: int = 0) -> dict[str, Any]:
    """Run the method of a case; threads of its models are one per processor if that is 0."""
    return METHODS[case.method](case, given, threads)


def options_of(case: Case, threads: int = 0) -> IdentifyOptions:
    """How our estimator is told to see the log of a case."""
    return IdentifyOptions(
        noise=case.preset,
        other_links=case.believed_other_links,
        link_inertia=case.believed_link_inertia,
        lag_s=case.believed_lag_s,
        seed=case.seed,
        threads=threads,
    )


def _all_unknowns(case: Case, given: Given, walk: Walk) -> ParameterSpace:
    """What the estimator takes as unknown, with the same priors; offsets of force sensors as this walk shows them."""
    return with_nuisances(given.space, given.robot, walk, PRESETS[case.preset], options_of(case))


def _massid(case: Case, given: Given, threads: int) -> dict[str, Any]:
    result = weigh(
        given.noisy,
        given.robot,
        given.links,
        mode="online" if case.method == "online" else "offline",
        held_out=0.0,
        checks=case.part == "verdict",
        options=options_of(case, threads),
    )
    error = result.estimate - given.truth(given.space)
    found = {
        "l2_kg": float(np.linalg.norm(error)),
        "error_kg": error.tolist(),
        "links": [parameter.target for parameter in given.space.parameters],
        "status": str(result.status),
        "warnings": list(result.warnings[len(given.noisy.warnings) :]),
        "wall_s": result.wall_s,
    }
    if case.part == "verdict":
        verdict = result.verdict
        assert verdict is not None  # asked for by `checks`
        found |= {"predicted_std_kg": verdict.std.tolist(), "hidden": list(verdict.hidden)}
    return found | _belief(result, error)


def _belief(result: Result, error: np.ndarray) -> dict[str, Any]:  # type: ignore[type-arg]
    uncertainty = result.uncertainty
    if uncertainty is None:
        return {}
    std = uncertainty.std[: len(error)]
    covariance = uncertainty.covariance[: len(error), : len(error)]
    distance = float(error @ np.linalg.solve(covariance, error))
    return {
        "std_kg": std.tolist(),
        "hits": [bool(hit) for hit in np.abs(error) <= INTERVAL_95 * std],
        "inside_ellipsoid": bool(distance <= chi2.ppf(0.95, len(error))),
        "inflation": uncertainty.inflation,
        "chi2_per_sample": uncertainty.chi2_per_sample,
    }


def _bound(case: Case, given: Given, _threads: int) -> dict[str, Any]:
    space = _all_unknowns(case, given, given.clean)
    found: dict[str, Any] = {}
    gates = (("gated", True), ("open", False)) if case.sensors == "all" else (("gated", True),)
    for name, gate in gates:
        bound = cramer_rao(given.clean, given.robot, space, given.truth(space), PRESETS[case.preset], gate=gate)
        found |= {f"{name}_l2_kg": bound.l2, f"{name}_std_kg": bound.std.tolist(), "problem": bound.problem}
    return found


def _least_squares(case: Case, given: Given, _threads: int) -> dict[str, Any]:
    space = _all_unknowns(case, given, given.noisy)
    asked = len(given.space)
    truth = given.truth(given.space)
    started = time.perf_counter()
    fits = scan_cutoffs(given.noisy, given.robot, space)
    wall_s = time.perf_counter() - started
    errors = {f"{fit.cutoff_hz:g}": float(np.linalg.norm(fit.estimate[:asked] - truth)) for fit in fits}
    chosen = self_chosen(fits)
    return {
        "l2_kg": errors[f"{chosen.cutoff_hz:g}"],
        "chosen_hz": chosen.cutoff_hz,
        "by_cutoff": errors,
        "wall_s": wall_s,
    }


def _sysid(case: Case, given: Given, threads: int) -> dict[str, Any]:
    weigh = weigh_by_chunks if case.method == "sysid" else weigh_by_observer
    found = weigh(given.noisy, given.robot, given.space, threads)
    error = found.estimate - given.truth(given.space)
    return {
        "l2_kg": float(np.linalg.norm(error)),
        "error_kg": error.tolist(),
        "half_width_kg": found.half_width.tolist(),
        "hits": [bool(hit) for hit in np.abs(error) <= found.half_width],
        "wall_s": found.wall_s,
    }


def _on_one_thread(method: Measure) -> Measure:
    def run(case: Case, given: Given, threads: int) -> dict[str, Any]:
        with single_threaded():
            return method(case, given, threads)

    return run


METHODS: dict[Method, Measure] = {
    "online": _massid,
    "offline": _massid,
    "bound": _on_one_thread(_bound),
    "least-squares": _on_one_thread(_least_squares),
    "sysid": _sysid,
    "sysid-observer": _sysid,
}
