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
from massid.identify.progress import Progress, silent
from massid.model.robot import Robot
from massid.observer.blas import single_threaded
from massid.observer.replay import SampleBuffer
from massid.observer.spans import Spans
from massid.result.posterior import ScoreScatter, posterior
from massid.result.result import Result, WindowResult
from massid.search.directions import SECOND_ORDER
from massid.search.guided import GuidedSearch, SearchStatus
from massid.search.monitoring import MonitoringFilter
from massid.search.parameters import ParameterSpace
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray
from massid.walk import Sample, Walk
from massid.walk.noise import SensorNoise

BLOCK_STEPS = 50
"""Samples that are handed to the bank at a time."""
LARGEST_BEND = 1.0
"""Beyond it a window of a noisy log has taught where to look next, and no more."""


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
        BadInputError: the bank is too small for the parameters, or a noisy walk is searched by a first-order direction.
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
        self._search = GuidedSearch(space, self.options.bank_size, self.options.search_for(noise), self._rng)
        self._windows: list[WindowResult] = []
        self._converged = False
        self._is_rough = self._starts_anew = True
        self._scatter = ScoreScatter(space.n_sampled)
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
        direction = self.options.search.direction
        if noise is not None and direction not in SECOND_ORDER:
            raise BadInputError(
                f"Direction {direction} does not reach the minimum in one pass over a noisy log, and intervals are "
                f"those of the minimum: choose one of {', '.join(sorted(SECOND_ORDER))}, or offline identification."
            )
        robot = self._robot
        assembly = assemble(robot, self.space, contact_bodies, timestep_s, noise, self.options)
        self._bank, self._forgetting_rate = assembly.bank, assembly.forgetting_rate
        self._look_ahead = 0 if noise is None else Spans.at(timestep_s).look_ahead
        capacity = BLOCK_STEPS + self._look_ahead + 1
        self._buffer = SampleBuffer(robot.layout, len(robot.joint_names), len(contact_bodies), capacity)
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
            options = replace(self.options.search_for(noise), radius=radius, scan=())
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

    def push(self, sample: Sample) -> tuple[WindowResult, ...]:
        """Take one sample; returns an update for each dwell window that it completes, mostly none.

        A sample that does not follow the one before by one period drops the window that it interrupts; windows that
        waited for samples to follow are closed without them, which may be several if they are short.

        Raises:
            DivergedBankError: too few models stayed finite in the window that this sample completes.
        """
        if self._converged:
            return ()
        closed: tuple[WindowResult, ...] = ()
        if self._first_stamp_ns is None:
            self._first_stamp_ns = sample.stamp_ns
        elif abs((sample.stamp_ns - self._last_stamp_ns) * 1e-9 - self._timestep_s) > 0.5 * self._timestep_s:
            closed = self.finish()
            self._open_window()
            self._buffer.clear()
            self._is_first = True
        self._last_stamp_ns = sample.stamp_ns
        self._pushed += 1
        self._log_s += self._timestep_s
        self._buffer.append(sample)
        return closed + self._work(self._buffer.n_steps - self._look_ahead)

    def finish(self) -> tuple[WindowResult, ...]:
        """Use the last samples of a walk, of which nothing follows; returns an update for each window they complete.

        Sensor noise makes each sample wait for those that follow it. To be called at the end of a walk; more samples
        may be pushed.

        Raises:
            DivergedBankError: too few models stayed finite in a window that is completed.
        """
        closed: tuple[WindowResult, ...] = ()
        while not self._converged and self._buffer.n_steps >= self._due:
            closed += self._work(self._buffer.n_steps)
        return closed

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
            self._robot,
            Findings(
                self.space, self.estimate, self._information, (), self._noise, self._last, self._scatter.inflation
            ),
            self._windows,
            self._converged or not self._is_rough,
            LogFacts("online", self._log_s, self._timestep_s, tuple(sources), tuple(warnings)),
            time.perf_counter() - self._started,
        )

    def _open_window(self) -> None:
        self._proposal = self._search.ask()
        self._bank.place(self._proposal.points)
        self._filter = MonitoringFilter(self.options.bank_size, self._timestep_s, self._forgetting_rate)
        self._steps = 0

    @property
    def _due(self) -> int:
        """Steps that the bank takes at a time, without passing the end of the window."""
        return min(BLOCK_STEPS, self._window_steps - self._steps)

    def _work(self, ready: int) -> tuple[WindowResult, ...]:
        """Advance the bank if enough steps are ready, and close the window if that fills it."""
        if ready < self._due:
            return ()
        with single_threaded():
            self._advance(self._due)
            return (self._close_window(),) if self._steps == self._window_steps else ()

    def _advance(self, n_steps: int) -> None:
        block = self._buffer.block(n_steps)
        if self._steps == 0:
            if self._is_first or self._starts_anew or not self._bank.carries_belief:
                self._bank.restart(block, follows=not self._is_first)
            else:
                self._bank.carry_on(self._samples)
            self._is_first = self._starts_anew = False
        self._filter.update(self._bank.advance(block))
        self._steps += n_steps
        self._buffer.drop(n_steps)

    def _close_window(self) -> WindowResult:
        monitoring = self._filter.result(self._proposal, self._belief)
        iteration = self._search.tell(monitoring)
        samples = self._proposal.samples
        self._samples = samples[~monitoring.diverged[samples]]
        # A window alone shows its slope too roughly.
        window_quadratic = replace(monitoring.window_quadratic(), slope=None)
        self._last = window_quadratic
        if self._belief is None:
            self._information = self._information + window_quadratic
            self._converged = iteration.status is SearchStatus.CONVERGED
            std = None
        else:
            found = posterior(self.space, self._belief + window_quadratic)
            bend = _bend(window_quadratic, iteration.estimate, found.covariance, self.space)
            if not self._is_rough and bend <= LARGEST_BEND:
                self._scatter.add(self._belief, window_quadratic)
            # Too far for the models to start the next window where they would stand there.
            self._starts_anew = self._is_rough = bend > LARGEST_BEND
            self._information = self._belief = self._belief + window_quadratic.scaled(1.0 / (1.0 + bend))
            found = posterior(self.space, self._belief, inflation=self._scatter.inflation)
            std = found.std[: self.space.n_sampled]
        waiting_s = self._buffer.n_steps * self._timestep_s
        time_s = self._earlier_s + (self._last_stamp_ns - (self._first_stamp_ns or 0)) * 1e-9 - waiting_s
        window = replace(WindowResult.from_iteration(iteration, time_s, std), index=len(self._windows))
        self._windows.append(window)
        self._open_window()
        return window


def _bend(window: LocalQuadratic, estimate: FloatArray, covariance: FloatArray, space: ParameterSpace) -> float:
    """Variance by which a window's quadratic may mislead at an estimate, in units of the noise's variance.

    Dynamics are rational functions of the masses: where a mass moves by a fraction rho of itself, derivatives of the
    output error by it, and by the errors of sensors, change by about rho. So does what was explained with them.

    Args:
        window: quadratic of one dwell window, around its own centre.
        estimate: where the search went, shape (n_p,).
        covariance: how uncertain that is, shape (n_p, n_p).
        space: what is unknown.
    """
    sampled, tangents = slice(space.n_sampled), slice(space.n_sampled, None)
    offset = estimate - window.centre
    squared = np.outer(offset, offset) + covariance
    explained = 0.5 * window.curvature * squared
    fraction = np.diagonal(squared)[sampled] / space.scale[sampled] ** 2
    return float(fraction @ np.diagonal(explained)[sampled] + fraction.max() * explained[tangents, tangents].sum())


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
            pushed += 1
            for window in identifier.push(sample):
                progress(pushed / n_samples, f"window {window.index + 1}")
            if identifier.converged:
                break
        identifier.finish()
    progress(1.0, "done")
    return identifier.result([log.walk.source for log in logs], gather_warnings(logs))
