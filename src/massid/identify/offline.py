"""Offline identification (Section IV-A): the log is replayed as often as it takes, and mu is summed over all of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from massid.identify.assembly import assemble
from massid.identify.averaging import suitable_reach_s
from massid.identify.conclusion import Findings, LogFacts, conclude
from massid.identify.logs import Log, gather_logs, gather_warnings, join_spaces
from massid.identify.online import BLOCK_STEPS
from massid.identify.options import IdentifyOptions
from massid.identify.progress import Progress, silent
from massid.model.robot import Robot
from massid.observer.blas import single_threaded
from massid.observer.replay import replay_block, split
from massid.observer.spans import REACH_S, Spans
from massid.result.result import Result, WindowResult
from massid.search.guided import GuidedSearch, Iteration, SearchStatus
from massid.search.monitoring import Monitoring, MonitoringFilter
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal
from massid.search.quadratic import LocalQuadratic
from massid.typing import IntArray
from massid.walk import Segment, Walk

SETTLED_DECREASE = 0.02
"""A noisy log is solved when a step would lower -2 log-likelihood by less, a seventh of a standard deviation."""
STALLED_PASSES, STALLED_SHARE = 3, 0.7
"""So many passes in a row that each leave more than this share of what was to be gained end the search: the log reveals
too little. Of a walk a tenth is left."""
FIRST_WINDOWS = 4
"""A noisy log is replayed no further than that until the estimate is about as good as so many windows can make it."""


def identify_offline(
    walks: Walk | Sequence[Walk],
    robot: Robot,
    space: ParameterSpace,
    options: IdentifyOptions | None = None,
    progress: Progress = silent,
) -> Result:
    """Minimise the sum of mu over all dwell windows of a log, or of several.

    Args:
        walks: the log, or several of the same robot. Masses are common to them; every log has errors of its sensors of
            its own.
        robot: the robot with nominal masses.
        space: what is unknown.
        options: how to identify.
        progress: told the fraction of the passes done.

    Raises:
        LogError: a log does not match the robot, or is shorter than one dwell window.
        BadInputError: some logs have sensor noise and some have none.
        DivergedBankError: too few models stayed finite.
    """
    with single_threaded():
        options = options or IdentifyOptions()
        return _identify(gather_logs(walks, robot, space, options), robot, options, progress)


def _identify(logs: Sequence[Log], robot: Robot, options: IdentifyOptions, progress: Progress) -> Result:
    started = time.perf_counter()
    joint = join_spaces(logs)
    space, noise = joint.space, logs[0].noise
    log_s = sum(log.walk.duration_s for log in logs)
    search = GuidedSearch(space, options.bank_size, options.search_for(noise), np.random.default_rng(options.seed))
    replays = [_Replay(log, robot, options, columns) for log, columns in zip(logs, joint.columns, strict=True)]
    prior = None if noise is None else LocalQuadratic.belief(space.nominal, space.prior_precision)
    trace: list[WindowResult] = []
    n_windows = max(replay.n_windows for replay in replays)
    in_use = n_windows if noise is None else FIRST_WINDOWS
    converged = False
    gains: list[float] = []
    for index in range(options.passes):
        scores = _score_all(replays, search.ask(), in_use, partial(_report, progress, index, options.passes))
        iteration = search.tell(replace(_total(scores), prior=prior))
        trace.append(replace(WindowResult.from_iteration(iteration, log_s), index=index))
        left = _decrease_left(iteration, space.n_sampled)
        gains.append(left)
        stalled = noise is not None and _is_stalled(gains)
        settled = iteration.status is SearchStatus.CONVERGED or (noise is not None and left < SETTLED_DECREASE)
        converged = settled and in_use >= n_windows
        if converged or (stalled and in_use >= n_windows):
            break
        if in_use < n_windows and (stalled or left < space.n_sampled):
            in_use = n_windows
            search = search.restarted()
            gains.clear()
    progress(1.0, "done")
    total = _total(scores).window_quadratic()
    information = (total if prior is None else total + prior).shifted(search.estimate)
    parts = () if noise is None else tuple(score.window_quadratic() for score in scores)
    return conclude(
        robot,
        Findings(space, search.estimate, information, parts, noise, total),
        trace,
        converged,
        LogFacts(
            "offline",
            log_s,
            max(log.walk.timestep_s for log in logs),
            tuple(log.walk.source for log in logs),
            gather_warnings(logs),
        ),
        time.perf_counter() - started,
    )


def _report(progress: Progress, index: int, passes: int, done: float) -> None:
    progress((index + done) / passes, f"pass {index + 1}")


def _decrease_left(iteration: Iteration, asked: int) -> float:
    """By how much the Newton step lowers mu over the parameters asked for, nuisances wherever they fit best.

    Args:
        iteration: with the step.
        asked: number of parameters that were asked for; they come first.
    """
    step = iteration.newton_step[:asked]
    return 0.5 * float(step @ iteration.quadratic.marginal(np.arange(asked)).curvature @ step)


def _is_stalled(gains: Sequence[float]) -> bool:
    """Whether passes no longer lower what is to be gained by further ones."""
    last = gains[-STALLED_PASSES - 1 :]
    return len(last) > STALLED_PASSES and all(after > STALLED_SHARE * before for before, after in pairwise(last))


def _score_all(
    replays: Sequence[_Replay], proposal: Proposal, in_use: int, progress: Callable[[float], None]
) -> list[Monitoring]:
    """Score a proposal in the first windows of every log."""
    n_windows, scores = sum(min(replay.n_windows, in_use) for replay in replays), []
    for replay in replays:
        for score in replay.run(proposal, in_use):
            scores.append(score)
            progress(len(scores) / n_windows)
    return scores


class _Replay:
    """Runs a bank through all windows of a log, pass after pass.

    Raises:
        LogError: the log is shorter than one dwell window.
    """

    def __init__(self, log: Log, robot: Robot, options: IdentifyOptions, columns: IntArray) -> None:
        walk = self._walk = log.walk
        self._windows = walk.filled_windows(options.dwell_s)
        reach_s = REACH_S if log.noise is None else suitable_reach_s(walk, log.noise)
        self._look_ahead = Spans.at(walk.timestep_s, reach_s).look_ahead
        self._assembly = assemble(
            robot, log.space, walk.contact_bodies, walk.timestep_s, log.noise, options, reach_s=reach_s
        )
        self._columns = columns
        self._fresh = {segment.start for segment in walk.segments}
        self._end_of = {
            window.start: segment.stop
            for segment in walk.segments
            for window in self._windows
            if segment.start <= window.start < segment.stop
        }

    @property
    def n_windows(self) -> int:
        """Dwell windows of the log."""
        return len(self._windows)

    def run(self, proposal: Proposal, in_use: int) -> Iterator[Monitoring]:
        """Score a proposal of all logs' unknowns in the first windows."""
        own = replace(proposal, points=proposal.points[:, self._columns])
        self._assembly.bank.place(own.points)
        for window in self._windows[:in_use]:
            yield self._score(window, own).embedded(proposal, self._columns)

    def _score(self, window: Segment, proposal: Proposal) -> Monitoring:
        bank = self._assembly.bank
        scores = MonitoringFilter(bank.n_models, bank.timestep_s, self._assembly.forgetting_rate)
        for part in split(window, BLOCK_STEPS):
            ahead = Segment(part.stop - 1, min(part.stop + self._look_ahead, self._end_of[window.start]))
            block = replay_block(self._walk, bank.robot.layout, part, ahead)
            if part.start == window.start and (not bank.carries_belief or window.start in self._fresh):
                bank.restart(block)
            scores.update(bank.advance(block))
        return scores.result(proposal)


def _total(scores: Sequence[Monitoring]) -> Monitoring:
    total = scores[0]
    for score in scores[1:]:
        total = total + score
    return total
