"""Online identification of a simulated system: plant, bank and search in one loop (Section IV-B).

Each dwell window the plant runs under the running estimate, the models run beside it on what is measured, and the
search, or whatever else asks and tells, moves on. Nothing of a window is kept but what those who score want to see.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from massid.search.bank import Bank
from massid.search.guided import Iteration, SearchStatus
from massid.search.online import Searcher, WindowScorer
from massid.systems.plant import Plant
from massid.systems.system import MeasuredBlock
from massid.typing import FloatArray


@dataclass(frozen=True)
class OnlineRun:
    """What came of it.

    Attributes:
        times_s: end of each window, from the start at 0, shape (1 + n_windows,).
        estimates: the estimate from each of those times on, shape (1 + n_windows, n_p).
        iterations: what a guided search made of each window.
        motion_times_s: beginning of each step [s], shape (n,); empty unless asked for.
        motion: states at those times, shape (n, n_x).
        blocks: what was measured; empty unless asked for.
        compute_s: processor time of all of it, plant included, so that other work on the machine does not count [s].
    """

    times_s: FloatArray
    estimates: FloatArray
    iterations: tuple[Iteration, ...]
    motion_times_s: FloatArray
    motion: FloatArray
    blocks: tuple[MeasuredBlock, ...]
    compute_s: float

    def errors(self, truth: FloatArray) -> FloatArray:
        """|p - p*| from each time on, shape (1 + n_windows,)."""
        return np.asarray(np.linalg.norm(self.estimates - truth, axis=1))

    def windows_until(self, truth: FloatArray, threshold: float) -> int | None:
        """Windows after which the error stays below a threshold; None if it does not."""
        above = np.flatnonzero(self.errors(truth) >= threshold)
        last = int(above[-1]) + 1 if len(above) else 0
        return last if last < len(self.times_s) else None


def run_online(
    plant: Plant,
    bank: Bank[MeasuredBlock],
    search: Searcher,
    windows: int,
    dwell_s: float,
    forgetting_rate: float,
    keep_motion: bool = False,
    keep_blocks: bool = False,
    stop_when_converged: bool = False,
) -> OnlineRun:
    """Search while the plant runs under the running estimate.

    Args:
        plant: the true system.
        bank: models of it.
        search: asks and is told.
        windows: how many dwell windows.
        dwell_s: length T of each [s].
        forgetting_rate: lambda of Eq. (6) [1/s].
        keep_motion: keep the plant's states for those who draw them.
        keep_blocks: keep what was measured for those who replay it.
        stop_when_converged: end at the termination condition of the search (Eq. 18).

    Raises:
        BadInputError: the plant left the finite numbers.
        DivergedBankError: too few models stayed finite.
    """
    started = time.process_time()
    times, estimates = [plant.time_s], [search.estimate]
    iterations: list[Iteration] = []
    motion_times: list[FloatArray] = []
    motions: list[FloatArray] = []
    blocks: list[MeasuredBlock] = []
    scorer = WindowScorer(bank, forgetting_rate)
    for _ in range(windows):
        motion = plant.run(dwell_s, search.estimate)
        iteration = search.tell(scorer.score(search.ask(), motion.block))
        if iteration is not None:
            iterations.append(iteration)
        times.append(plant.time_s)
        estimates.append(search.estimate)
        if keep_motion:
            motion_times.append(motion.times_s)
            motions.append(motion.states)
        if keep_blocks:
            blocks.append(motion.block)
        if stop_when_converged and iteration is not None and iteration.status is SearchStatus.CONVERGED:
            break
    return OnlineRun(
        times_s=np.array(times),
        estimates=np.array(estimates),
        iterations=tuple(iterations),
        motion_times_s=np.concatenate(motion_times) if motion_times else np.zeros(0),
        motion=np.concatenate(motions) if motions else np.zeros((0, plant.system.n_x)),
        blocks=tuple(blocks),
        compute_s=time.process_time() - started,
    )
