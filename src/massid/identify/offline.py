"""Offline identification (Section IV-A): the log is replayed as often as it takes, and mu is summed over all of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import reduce
from operator import add

import numpy as np

from massid.identify.conclusion import LogFacts, conclude
from massid.identify.findings import Findings
from massid.identify.inference import inference_for
from massid.identify.logs import PreparedLog, join_spaces
from massid.identify.options import IdentifyOptions
from massid.identify.progress import Progress, never, silent
from massid.identify.replay import WalkReplay
from massid.model.robot import Robot
from massid.result.result import Result, WindowResult
from massid.search.guided import GuidedSearch
from massid.search.offline import run_offline
from massid.typing import FloatArray


def identify_offline(
    logs: Sequence[PreparedLog],
    robot: Robot,
    options: IdentifyOptions | None = None,
    progress: Progress = silent,
    stop: Callable[[], bool] = never,
    start: FloatArray | None = None,
) -> Result:
    """Minimise the sum of mu over all dwell windows of a log, or of several.

    Args:
        logs: of the same robot. Masses are common to them; every log has errors of its sensors of its own.
        robot: the robot with nominal masses.
        options: how to identify.
        progress: told the fraction of the passes done.
        stop: asked after every window; once it says so, the passes completed by then are all there are.
        start: where the search begins, in the space of all logs' unknowns; default the nominal values.

    Raises:
        LogError: a log is shorter than one dwell window.
        BadInputError: the bank is too small for the parameters.
        DivergedBankError: too few models stayed finite.
        StoppedError: stopped in the first pass.
    """
    options = options or IdentifyOptions()
    started = time.perf_counter()
    joint = join_spaces(logs)
    space, inference = joint.space, inference_for(logs[0].sensors)
    n_models = options.models(space.n_sampled)
    search = GuidedSearch(
        space,
        n_models,
        inference.search_options(options.search, replayed=True),
        np.random.default_rng(options.seed),
        () if start is None else (start,),
    )
    prior = inference.prior(space)

    def tell(index: int, done: float) -> None:
        progress((index + done) / options.passes, f"pass {index + 1}")

    replays = [
        WalkReplay(log, robot, options, n_models, columns) for log, columns in zip(logs, joint.columns, strict=True)
    ]
    run = run_offline(
        replays, search, options.passes, inference.pass_rule(space, near=start is not None), prior, tell, stop
    )
    progress(1.0, "done")
    log_s = sum(log.walk.duration_s for log in logs)
    found = [WindowResult.from_iteration(one, space.n_sampled, log_s) for one in run.iterations]
    trace = [replace(one, index=k) for k, one in enumerate(found)]
    total = reduce(add, run.scores).window_quadratic()
    told, weights = total.symmetric(), total.weights
    information = (told if prior is None else told + prior).shifted(run.estimate)
    parts = [score.window_quadratic().shifted(run.estimate) for score in run.scores]
    result = conclude(
        robot,
        Findings(
            space,
            run.estimate,
            information,
            total,
            tuple(part.weighed(weights) for part in parts),
            rise=run.rise,
        ),
        inference,
        trace,
        run.converged,
        LogFacts(
            "offline",
            log_s,
            max(log.walk.timestep_s for log in logs),
            tuple(log.walk.source for log in logs),
        ),
        time.perf_counter() - started,
    )
    inflation = 1.0 if result.uncertainty is None else result.uncertainty.inflation
    deviations = [inference.deviations(space, one.quadratic, inflation) for one in run.iterations]
    windows = tuple(replace(window, std=std) for window, std in zip(result.windows, deviations, strict=True))
    result = replace(result, windows=windows)
    return result.stopped_early() if run.stopped else result
