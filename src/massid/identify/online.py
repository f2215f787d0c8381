"""Online identification (Section IV-B): every dwell window is seen once, and nothing of it is stored."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from massid.errors import BadInputError, LogError
from massid.identify.assembly import assemble
from massid.identify.conclusion import Findings, LogFacts, conclude
from massid.identify.logs import gather_logs, gather_warnings, hand_over, start_from
from massid.identify.options import IdentifyOptions
from massid.identify.posterior import posterior
from massid.identify.progress import Progress, silent
from massid.identify.result import Result, WindowResult
from massid.log.walk import Sample, Walk
from massid.noise import SensorNoise
from massid.observer.blas import single_threaded
from massid.observer.replay import SampleBuffer
from massid.parameters import ParameterSpace
from massid.robot import Robot
from massid.search.guided import GuidedSearch, SearchStatus
from massid.search.monitoring import MonitoringFilter
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

BLOCK_STEPS = 50
"""Samples that are handed to the bank at a time; the only buffer there is."""


class OnlineIdentifier:
    """Identifies while samples arrive, from a log or from a robot that is walking now.

    Args:
        robot: the robot with nominal masses.
        space: what is unknown.
        contact_bodies: bodies whose wrench is measured, in the order of the samples' rows.
        timestep_s: sample period [s].
        options: how to identify.
        noise: sensor noise; None for measurements without noise. (`options.noise` is for logs, which can be looked at
            before they are used.)

    Raises:
        BadInputError: the bank is too small for the parameters.
        ModelError: a contact body is not in the model.
    """

    def __init__(
        self,
        robot: Robot,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        timestep_s: float,
        options: IdentifyOptions | None = None,
        noise: SensorNoise | None = None,
    ) -> None:
        self.options = options or IdentifyOptions()
        self.space = space
        self._robot = robot
        self._rng = np.random.default_rng(self.options.seed)
        self._search = GuidedSearch(space, self.options.bank_size, self.options.search, self._rng)
        self._windows: list[WindowResult] = []
        self._converged = False
        self._pushed = 0
        self._log_s = self._earlier_s = 0.0
        self._started = time.perf_counter()
        self._belief = self._start(contact_bodies, timestep_s, noise)
        self._information = self._belief or LocalQuadratic.belief(space.nominal, np.zeros(len(space)))
        self._open_window()

    def _start(
        self, contact_bodies: Sequence[str], timestep_s: float, noise: SensorNoise | None
    ) -> LocalQuadratic | None:
        """Build the bank for a walk; returns the prior of its unknowns."""
        self._timestep_s, self._noise = timestep_s, noise
        self._window_steps = round(self.options.dwell_s / timestep_s)
        if self._window_steps < 2:
            raise LogError(f"A dwell time of {self.options.dwell_s} s is shorter than two samples of {timestep_s} s.")
        robot = self._robot
        assembly = assemble(robot, self.space, contact_bodies, timestep_s, noise, self.options)
        self._bank, self._forgetting_rate = assembly.bank, assembly.forgetting_rate
        self._buffer = SampleBuffer(robot.layout, len(robot.joint_names), len(contact_bodies), BLOCK_STEPS + 1)
        self._is_first = True
        self._first_stamp_ns: int | None = None
        self._last_stamp_ns = 0
        return assembly.prior

    def start_walk(
        self,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        timestep_s: float,
        noise: SensorNoise | None = None,
    ) -> None:
        """Go on with another walk of the same robot: what is known of its masses stays, sensors begin anew.

        Args:
            space: the same parameters asked for, with the nuisances of this walk.
            contact_bodies: bodies whose wrench is measured in it.
            timestep_s: its sample period [s].
            noise: of its sensors; None if and only if the walks before had none.

        Raises:
            BadInputError: other parameters are asked for, or only some of the walks have sensor noise.
            ModelError: a contact body is not in the model.
        """
        asked = space.parameters[: space.n_sampled]
        if asked != self.space.parameters[: self.space.n_sampled] or (noise is None) != (self._noise is None):
            raise BadInputError("A further walk must ask for the same parameters and have sensor noise as before.")
        before, self.space = self.space, space
        self._earlier_s = self._log_s
        prior = self._start(contact_bodies, timestep_s, noise)
        if self._belief is not None and prior is not None:
            self._information = self._belief = hand_over(self._belief, before, space)
            radius = max(self._search.radius, self.options.search.smallest_radius)
            options = replace(self.options.search, radius=radius, scan=())
            estimate = start_from(self._search.estimate, before, space)
            self._search = GuidedSearch(space, self.options.bank_size, options, self._rng, [estimate])
        self._open_window()

    @property
    def estimate(self) -> FloatArray:
        """The current estimate, shape (n_p,)."""
        return self._search.estimate

    @property
    def converged(self) -> bool:
        """Whether the search has met its termination condition; further samples change nothing."""
        return self._converged

    def push(self, sample: Sample) -> WindowResult | None:
        """Take one sample; returns an update whenever a dwell window is complete.

        A sample that does not follow the one before by one period drops the window that it interrupts.

        Raises:
            DivergedBankError: too few models stayed finite in the window that this sample completes.
        """
        if self._converged:
            return None
        if self._first_stamp_ns is None:
            self._first_stamp_ns = sample.stamp_ns
        elif abs((sample.stamp_ns - self._last_stamp_ns) * 1e-9 - self._timestep_s) > 0.5 * self._timestep_s:
            self._open_window()
            self._buffer.clear()
            self._is_first = True
        self._last_stamp_ns = sample.stamp_ns
        self._pushed += 1
        self._log_s += self._timestep_s
        self._buffer.append(sample)
        window_is_full = self._steps + self._buffer.n_steps == self._window_steps
        if self._buffer.n_steps < BLOCK_STEPS and not window_is_full:
            return None
        with single_threaded():
            self._advance()
            return self._close_window() if window_is_full else None

    def result(self, sources: Sequence[str] = ("walk",), warnings: Sequence[str] = ()) -> Result:
        """What has been found so far.

        Args:
            sources: names of the walks.
            warnings: to be said with the result, one line each.

        Raises:
            LogError: not one dwell window was complete.
        """
        if not self._windows:
            raise LogError(
                f"{', '.join(sources)}: {self._pushed} samples of {self._timestep_s} s do not fill one dwell window of "
                f"{self.options.dwell_s} s; record a longer walk or use a shorter --dwell-s."
            )
        return conclude(
            Findings(self.space, self.estimate, self._information, (), self._noise, self._last),
            self._windows,
            self._converged,
            LogFacts("online", self._log_s, self._timestep_s, tuple(sources), tuple(warnings)),
            time.perf_counter() - self._started,
        )

    def _open_window(self) -> None:
        self._proposal = self._search.ask()
        self._bank.place(self._proposal.points)
        self._filter = MonitoringFilter(self.options.bank_size, self._timestep_s, self._forgetting_rate)
        self._steps = 0

    def _advance(self) -> None:
        block = self._buffer.block()
        if self._steps == 0:
            if self._is_first or not self._bank.carries_belief:
                self._bank.restart(block)
            else:
                self._bank.carry_on(self._samples)
            self._is_first = False
        self._filter.update(self._bank.advance(block))
        self._steps += len(block)
        self._buffer.keep_last()

    def _close_window(self) -> WindowResult:
        monitoring = self._filter.result(self._proposal, self._belief)
        iteration = self._search.tell(monitoring)
        samples = self._proposal.samples
        self._samples = samples[~monitoring.diverged[samples]]
        window_quadratic = monitoring.window_quadratic()
        self._last = window_quadratic
        if self._belief is None:
            self._information = self._information + window_quadratic
            self._converged = iteration.status is SearchStatus.CONVERGED
            std = None
        else:
            self._information = self._belief = self._belief + _discounted(
                window_quadratic, iteration.estimate, self.space.n_sampled
            )
            std = posterior(self.space, self._belief).std[: self.space.n_sampled]
        time_s = self._earlier_s + (self._last_stamp_ns - (self._first_stamp_ns or 0)) * 1e-9
        window = replace(WindowResult.from_iteration(iteration, time_s, std), index=len(self._windows))
        self._windows.append(window)
        self._open_window()
        return window


def _discounted(window: LocalQuadratic, estimate: FloatArray, n_sampled: int) -> LocalQuadratic:
    """Weight a window's information by how far it can be trusted at the estimate that it led to.

    The samples left `misfit` unexplained when they changed mu by `explained`; at the estimate, where mu differs by D
    from the centre, that is misfit (D / explained)^2 in units of variance, to be added to the 1 that noise is.
    """
    change = window.change(estimate - window.centre, n_sampled)
    return window.scaled(1.0 / (1.0 + window.misfit * (change / window.explained) ** 2))


def identify_online(
    walks: Walk | Sequence[Walk],
    robot: Robot,
    space: ParameterSpace,
    options: IdentifyOptions | None = None,
    progress: Progress = silent,
) -> Result:
    """Play recorded walks once, one after the other, sample by sample, into an `OnlineIdentifier`.

    Args:
        walks: the log, or several of the same robot.
        robot: the robot with nominal masses.
        space: what is unknown.
        options: how to identify.
        progress: told the fraction done and the current estimate's window.

    Raises:
        LogError: a log does not match the robot, or none fills one dwell window.
        BadInputError: some logs have sensor noise and some have none.
        DivergedBankError: too few models stayed finite.
    """
    options = options or IdentifyOptions()
    logs = gather_logs(walks, robot, space, options)
    first, n_samples, pushed = logs[0], sum(len(log.walk) for log in logs), 0
    identifier = OnlineIdentifier(
        robot, first.space, first.walk.contact_bodies, first.walk.timestep_s, options, first.noise
    )
    for log in logs:
        if identifier.converged:
            break
        if log is not first:
            identifier.start_walk(log.space, log.walk.contact_bodies, log.walk.timestep_s, log.noise)
        for sample in log.walk.samples():
            window = identifier.push(sample)
            pushed += 1
            if window is not None:
                progress(pushed / n_samples, f"window {window.index + 1}")
            if identifier.converged:
                break
    progress(1.0, "done")
    return identifier.result([log.walk.source for log in logs], gather_warnings(logs))
