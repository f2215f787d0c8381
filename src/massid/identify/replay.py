"""A log and the bank that is run through it, window by window."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property, partial

import numpy as np

from massid.errors import BadInputError
from massid.identify.logs import PreparedLog
from massid.identify.options import IdentifyOptions
from massid.model.robot import Robot
from massid.observer.bank import RobotBank
from massid.observer.blas import single_threaded
from massid.search.monitoring import Monitoring, MonitoringFilter
from massid.search.proposal import Proposal, Role
from massid.typing import FloatArray, IntArray
from massid.walk import Segment


class WalkReplay:
    """Runs a bank through all windows of a log, pass after pass.

    The search asks it for whole proposals (`run`); any other optimiser for scores of points (`score`).

    Args:
        log: with its sensor model.
        robot: with nominal masses.
        options: how to identify.
        n_models: size of the bank.
        columns: where the log's own unknowns are among those of all logs; default that it is the only one.

    Raises:
        LogError: the log is shorter than one dwell window.
    """

    def __init__(
        self,
        log: PreparedLog,
        robot: Robot,
        options: IdentifyOptions,
        n_models: int,
        columns: IntArray | None = None,
    ) -> None:
        walk = self._walk = log.walk
        self._windows = walk.filled_windows(options.dwell_s)
        sensors = log.sensors.suited_to(walk)
        self._make = partial(sensors.bank, robot, log.space, walk.contact_bodies, walk.timestep_s)
        self._bank = self._make(n_models, options.threads, slopes=True)
        self._alone = self._make(1, 1)
        self._threads = options.threads
        self._forgetting_rate = sensors.forgetting_rate
        self._columns = np.arange(len(log.space)) if columns is None else columns
        self._fresh = {segment.start for segment in walk.segments}
        self._end_of = {
            window.start: segment.stop
            for segment in walk.segments
            for window in self._windows
            if segment.start <= window.start < segment.stop
        }

    @cached_property
    def _plain(self) -> RobotBank:
        """As many models without derivatives, for who wants scores alone."""
        return self._make(self._bank.n_models, self._threads, tangents=False)

    @property
    def n_windows(self) -> int:
        """Dwell windows of the log."""
        return len(self._windows)

    def run(self, proposal: Proposal, in_use: int) -> Iterator[Monitoring]:
        """Score a proposal of all logs' unknowns in the first windows."""
        own = proposal.of(self._columns)
        bank = self._alone if len(own.points) == 1 else self._bank
        bank.place(own.points)
        for window in self._windows[:in_use]:
            yield self._score(bank, window, own).embedded(proposal, self._columns)

    def score(self, points: FloatArray) -> FloatArray:
        """Mu of models at any points, summed over all windows: what there is to be minimised, for any optimiser.

        Args:
            points: as many as the bank has models; those asked for and this log's nuisances, shape (n_models, n_p).

        Returns:
            Shape (n_models,); inf for models that diverged.

        Raises:
            BadInputError: another number of points.
        """
        points = np.asarray(points, dtype=np.float64)
        if len(points) != self._bank.n_models:
            raise BadInputError(f"{len(points)} points for a bank of {self._bank.n_models} models.")
        proposal = Proposal(points, (Role.CENTRE, *[Role.CANDIDATE] * (len(points) - 1)))
        with single_threaded():
            self._plain.place(points)
            scores = [self._score(self._plain, window, proposal) for window in self._windows]
        return np.asarray(sum(one.mu for one in scores))

    def _score(self, bank: RobotBank, window: Segment, proposal: Proposal) -> Monitoring:
        scores = MonitoringFilter(bank.n_models, bank.timestep_s, self._forgetting_rate)
        anew = not bank.carries_belief or window.start in self._fresh
        for _, errors in bank.replay(self._walk, window, stop=self._end_of[window.start], restart=anew):
            scores.update(errors)
        return scores.result(proposal)
