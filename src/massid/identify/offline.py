"""Offline identification (Section IV-A): the log is replayed as often as it takes, and mu is summed over all of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from massid.errors import LogError
from massid.identify.assembly import Assembly, assemble
from massid.identify.conclusion import Findings, LogFacts, conclude
from massid.identify.online import BLOCK_STEPS
from massid.identify.options import IdentifyOptions
from massid.identify.progress import Progress, silent
from massid.identify.result import Result, WindowResult
from massid.identify.sensing import resolve_noise, with_nuisances
from massid.log.walk import Segment, Walk
from massid.observer.blas import single_threaded
from massid.observer.replay import replay_block, split
from massid.parameters import ParameterSpace
from massid.robot import Robot
from massid.search.guided import GuidedSearch, Iteration, SearchStatus
from massid.search.monitoring import Monitoring, MonitoringFilter
from massid.search.proposal import Proposal

SETTLED_DECREASE = 1e-3
"""A noisy log is solved when a step would lower -2 log-likelihood by less, a thirtieth of a standard deviation."""


def identify_offline(
    walk: Walk,
    robot: Robot,
    space: ParameterSpace,
    options: IdentifyOptions | None = None,
    progress: Progress = silent,
) -> Result:
    """Minimise the sum of mu over all dwell windows of a log.

    Args:
        walk: the log.
        robot: the robot with nominal masses.
        space: what is unknown.
        options: how to identify.
        progress: told the fraction of the passes done.

    Raises:
        LogError: the log does not match the robot, or is shorter than one dwell window.
        DivergedBankError: too few models stayed finite.
    """
    with single_threaded():
        return _identify(walk, robot, space, options or IdentifyOptions(), progress)


def _identify(walk: Walk, robot: Robot, space: ParameterSpace, options: IdentifyOptions, progress: Progress) -> Result:
    started = time.perf_counter()
    walk = robot.align(walk)
    windows = list(walk.windows(options.dwell_s))
    if not windows:
        raise LogError(
            f"{walk.source}: {walk.duration_s:.3g} s of samples do not fill one dwell window of {options.dwell_s} s; "
            "record a longer walk or use a shorter --dwell-s."
        )
    noise = resolve_noise(walk, options)
    if noise is not None:
        space = with_nuisances(space, robot, walk, noise, options)
    search = GuidedSearch(space, options.bank_size, options.search, np.random.default_rng(options.seed))
    replay = _Replay(assemble(robot, space, walk.contact_bodies, walk.timestep_s, noise, options), walk, windows)
    trace: list[WindowResult] = []
    converged = False
    for index in range(options.passes):
        scores = replay.run(search.ask(), partial(_report, progress, index, options.passes))
        iteration = search.tell(_total(scores))
        trace.append(WindowResult.from_iteration(iteration, walk.duration_s))
        converged = iteration.status is SearchStatus.CONVERGED or (noise is not None and _is_settled(iteration))
        if converged:
            break
    progress(1.0, "done")
    total = _total(scores).window_quadratic()
    chi2_per_sample = total.value / total.samples
    parts = () if noise is None else tuple(score.window_quadratic() for score in scores)
    return conclude(
        Findings(space, search.estimate, iteration.quadratic.shifted(search.estimate), parts, noise, chi2_per_sample),
        trace,
        converged,
        LogFacts("offline", walk.duration_s, walk.timestep_s, walk.source, walk.warnings),
        time.perf_counter() - started,
    )


def _report(progress: Progress, index: int, passes: int, done: float) -> None:
    progress((index + done) / passes, f"pass {index + 1}")


def _is_settled(iteration: Iteration) -> bool:
    """Whether the step left to take lowers -2 log-likelihood by next to nothing."""
    step = iteration.newton_step
    return 0.5 * float(step @ iteration.quadratic.curvature @ step) < SETTLED_DECREASE


class _Replay:
    """Runs the bank through all windows of a log, pass after pass."""

    def __init__(self, assembly: Assembly, walk: Walk, windows: Sequence[Segment]) -> None:
        self._assembly = assembly
        self._walk = walk
        self._windows = windows
        self._fresh = {segment.start for segment in walk.segments}

    def run(self, proposal: Proposal, progress: Callable[[float], None]) -> list[Monitoring]:
        """Score a proposal in every window."""
        self._assembly.bank.place(proposal.points)
        scores = []
        for k, window in enumerate(self._windows):
            scores.append(self._score(window, proposal))
            progress((k + 1) / len(self._windows))
        return scores

    def _score(self, window: Segment, proposal: Proposal) -> Monitoring:
        bank = self._assembly.bank
        scores = MonitoringFilter(bank.n_models, bank.timestep_s, self._assembly.forgetting_rate)
        for part in split(window, BLOCK_STEPS):
            block = replay_block(self._walk, bank.robot.layout, part)
            if part.start == window.start and (not bank.carries_belief or window.start in self._fresh):
                bank.restart(block)
            scores.update(bank.advance(block))
        return scores.result(proposal, self._assembly.prior)


def _total(scores: Sequence[Monitoring]) -> Monitoring:
    total = scores[0]
    for score in scores[1:]:
        total = total + score
    return total
