"""Offline identification (Section IV-A): the log is replayed as often as it takes, and mu is summed over all of it."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from massid.errors import LogError
from massid.identify.excitation import assess_excitation
from massid.identify.online import BLOCK_STEPS, make_bank
from massid.identify.options import IdentifyOptions
from massid.identify.progress import Progress, silent
from massid.identify.result import Result, Status, WindowResult
from massid.log.walk import Segment, Walk
from massid.observer.bank import RobotBank
from massid.observer.replay import replay_block, split
from massid.parameters import ParameterSpace
from massid.robot import Robot
from massid.search.guided import GuidedSearch, SearchStatus
from massid.search.monitoring import Monitoring, MonitoringFilter
from massid.search.proposal import Proposal


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
    started = time.perf_counter()
    options = options or IdentifyOptions()
    walk = robot.align(walk)
    windows = list(walk.windows(options.dwell_s))
    if not windows:
        raise LogError(
            f"{walk.source}: {walk.duration_s:.3g} s of samples do not fill one dwell window of {options.dwell_s} s; "
            "record a longer walk or use a shorter --dwell-s."
        )
    search = GuidedSearch(space, options.bank_size, options.search, np.random.default_rng(options.seed))
    bank = make_bank(robot, space, walk.contact_bodies, walk.timestep_s, options)
    trace: list[WindowResult] = []
    status = Status.NOT_CONVERGED
    for index in range(options.passes):
        proposal = search.ask()
        bank.place(proposal.points)
        scores: list[Monitoring] = []
        for k, window in enumerate(windows):
            scores.append(_run_window(bank, walk, window, proposal, options))
            progress((index + (k + 1) / len(windows)) / options.passes, f"pass {index + 1}")
        iteration = search.tell(_total(scores))
        trace.append(WindowResult.from_iteration(iteration, walk.duration_s))
        if iteration.status is SearchStatus.CONVERGED:
            status = Status.CONVERGED
            break
    progress(1.0, "done")
    excitation = assess_excitation(space, iteration.quadratic.curvature, walk.timestep_s)
    if not excitation.identifiable.all():
        status = Status.NOT_IDENTIFIABLE
    return Result(
        space=space,
        estimate=search.estimate,
        status=status,
        windows=tuple(trace),
        excitation=excitation,
        mode="offline",
        log_s=walk.duration_s,
        wall_s=time.perf_counter() - started,
        warnings=walk.warnings,
        source=walk.source,
    )


def _run_window(
    bank: RobotBank, walk: Walk, window: Segment, proposal: Proposal, options: IdentifyOptions
) -> Monitoring:
    scores = MonitoringFilter(bank.n_models, bank.timestep_s, options.forgetting_rate)
    for part in split(window, BLOCK_STEPS):
        block = replay_block(walk, bank.robot.layout, part)
        if part.start == window.start:
            bank.restart(block)
        scores.update(bank.advance(block))
    return scores.result(proposal)


def _total(scores: Sequence[Monitoring]) -> Monitoring:
    total = scores[0]
    for score in scores[1:]:
        total = total + score
    return total
