"""Online identification (Section IV-B): every dwell window is seen once, and nothing of it is stored."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from massid.errors import BadInputError, LogError
from massid.identify.conclusion import LogFacts, conclude
from massid.identify.findings import Findings
from massid.identify.inference import inference_for
from massid.identify.logs import PreparedLog, start_from
from massid.identify.options import IdentifyOptions
from massid.identify.progress import Progress, never, silent
from massid.model.robot import Robot
from massid.observer.blas import single_threaded
from massid.observer.replay import BLOCK_STEPS, ReplayBlock, SampleBuffer
from massid.observer.sensors import ExactSensors, SensorModel
from massid.result.result import Result, WindowResult
from massid.search.guided import GuidedSearch
from massid.search.online import WindowScorer
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Sample


class OnlineIdentifier:
    """Identifies while samples arrive, from a log or from a robot that is walking now.

    Args:
        robot: the robot with nominal masses.
        space: what is unknown.
        contact_bodies: bodies whose wrench is measured, in the order of the samples' rows.
        timestep_s: sample period [s].
        options: how to identify.
        sensors: what the sensors are taken to do; default measurements without noise. (`options.noise` is for logs,
            which can be looked at before they are used.)

    Raises:
        BadInputError: the bank is too small for the parameters, or a noisy walk is searched by a first-order direction.
        LogError: a dwell time shorter than two samples.
        ModelError: a contact body is not in the model.
    """

    def __init__(
        self,
        robot: Robot,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        timestep_s: float,
        options: IdentifyOptions | None = None,
        sensors: SensorModel | None = None,
    ) -> None:
        self.options = options or IdentifyOptions()
        self.space = space
        self._robot = robot
        self._sensors = sensors or ExactSensors(
            self.options.bandwidth_rad_s, self.options.damping_ratio, self.options.forgetting_rate
        )
        self._inference = inference_for(self._sensors)
        self._n_models = self.options.models(space.n_sampled)
        self._search = GuidedSearch(
            space,
            self._n_models,
            self._inference.search_options(self.options.search, replayed=False),
            np.random.default_rng(self.options.seed),
        )
        self._learning = self._inference.learning(space, self.options, timestep_s)
        self._windows: list[WindowResult] = []
        self._pushed = 0
        self._log_s = self._earlier_s = 0.0
        self._started = time.perf_counter()
        self._start(contact_bodies, timestep_s)
        self._open_window()

    def _start(self, contact_bodies: Sequence[str], timestep_s: float) -> None:
        """Build the bank for a walk."""
        self._timestep_s = timestep_s
        self._window_steps = round(self.options.dwell_s / timestep_s)
        if self._window_steps < 2:
            raise LogError(f"A dwell time of {self.options.dwell_s} s is shorter than two samples of {timestep_s} s.")
        robot, sensors = self._robot, self._sensors
        bank = sensors.bank(
            robot, self.space, contact_bodies, timestep_s, self._n_models, n_threads=self.options.threads
        )
        self._scorer: WindowScorer[ReplayBlock] = WindowScorer(bank, sensors.forgetting_rate)
        self._look_ahead = bank.look_ahead
        capacity = BLOCK_STEPS + self._look_ahead + 1
        self._buffer = SampleBuffer(robot.layout, len(robot.joint_names), len(contact_bodies), capacity)
        self._first_stamp_ns: int | None = None
        self._last_stamp_ns = 0

    def start_walk(
        self,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        timestep_s: float,
        sensors: SensorModel | None = None,
    ) -> None:
        """Go on with another walk of the same robot: what is known of its masses stays, sensors begin anew.

        Args:
            space: the same parameters asked for, with the nuisances of this walk.
            contact_bodies: bodies whose wrench is measured in it.
            timestep_s: its sample period [s].
            sensors: of it; None if and only if the walks before had exact ones.

        Raises:
            BadInputError: other parameters are asked for, or only some of the walks have sensor noise.
            ModelError: a contact body is not in the model.
        """
        asked = space.parameters[: space.n_sampled]
        sensors = sensors or ExactSensors()
        if asked != self.space.parameters[: self.space.n_sampled] or type(sensors) is not type(self._sensors):
            raise BadInputError("A further walk must ask for the same parameters and have sensor noise as before.")
        before, self.space, self._sensors = self.space, space, sensors
        self._inference = inference_for(sensors)
        self._earlier_s = self._log_s
        self._start(contact_bodies, timestep_s)
        if self._learning.next_walk(before, space):
            self._search = self._search.moved_to(space, start_from(self._search.estimate, before, space))
        self._open_window()

    @property
    def estimate(self) -> FloatArray:
        """The current estimate, shape (n_p,)."""
        return self._search.estimate

    @property
    def converged(self) -> bool:
        """Whether the search has met its termination condition; further samples change nothing."""
        return self._learning.converged

    def push(self, sample: Sample) -> tuple[WindowResult, ...]:
        """Take one sample; returns an update for each dwell window that it completes, mostly none.

        A sample that does not follow the one before by one period drops the window that it interrupts; windows that
        waited for samples to follow are closed without them, which may be several if they are short. A sample with a
        number that is not finite counts as lost.

        Raises:
            DivergedBankError: too few models stayed finite in the window that this sample completes.
        """
        if self.converged or not sample.is_finite:
            return ()
        closed: tuple[WindowResult, ...] = ()
        if self._first_stamp_ns is None:
            self._first_stamp_ns = sample.stamp_ns
        elif abs((sample.stamp_ns - self._last_stamp_ns) * 1e-9 - self._timestep_s) > 0.5 * self._timestep_s:
            closed = self.finish()
            self._open_window()
            self._buffer.clear()
            self._scorer.interrupt()
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
        while not self.converged and self._buffer.n_steps >= self._due:
            closed += self._work(self._buffer.n_steps)
        return closed

    def result(self, sources: Sequence[str] = ("walk",)) -> Result:
        """What has been found so far.

        Args:
            sources: names of the walks.

        Raises:
            LogError: not one dwell window was complete.
        """
        if not self._windows:
            raise LogError(
                f"{', '.join(sources)}: {self._pushed} samples of {self._timestep_s} s do not fill one dwell window of "
                f"{self.options.dwell_s} s; record a longer walk or use a shorter `dwell_s`."
            )
        learnt = self._learning
        return conclude(
            self._robot,
            Findings(self.space, self.estimate, learnt.information, learnt.last, inflation=learnt.inflation),
            self._inference,
            self._windows,
            learnt.settled,
            LogFacts("online", self._log_s, self._timestep_s, tuple(sources)),
            time.perf_counter() - self._started,
        )

    def _open_window(self) -> None:
        self._proposal = self._search.ask()
        self._scorer.open(self._proposal, anew=self._learning.starts_anew)
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
            n_steps = self._due
            self._scorer.advance(self._buffer.block(n_steps))
            self._steps += n_steps
            self._buffer.drop(n_steps)
            return (self._close_window(),) if self._steps == self._window_steps else ()

    def _close_window(self) -> WindowResult:
        monitoring = self._scorer.close(self._learning.belief)
        iteration = self._search.tell(monitoring)
        std = self._learning.learn(monitoring, iteration)
        waiting_s = self._buffer.n_steps * self._timestep_s
        time_s = self._earlier_s + (self._last_stamp_ns - (self._first_stamp_ns or 0)) * 1e-9 - waiting_s
        window = replace(
            WindowResult.from_iteration(iteration, self.space.n_sampled, time_s, std), index=len(self._windows)
        )
        self._windows.append(window)
        self._open_window()
        return window


def identify_online(
    logs: Sequence[PreparedLog],
    robot: Robot,
    options: IdentifyOptions | None = None,
    progress: Progress = silent,
    stop: Callable[[], bool] = never,
) -> Result:
    """Play recorded walks once, one after the other, sample by sample, into an `OnlineIdentifier`.

    Args:
        logs: of the same robot.
        robot: the robot with nominal masses.
        options: how to identify.
        progress: told the fraction done and the current estimate's window.
        stop: asked after every window; once it says so, the windows completed by then are all there are.

    Raises:
        LogError: none of the logs fills one dwell window.
        BadInputError: see `OnlineIdentifier`.
        DivergedBankError: too few models stayed finite.
    """
    first, n_samples, pushed = logs[0], sum(len(log.walk) for log in logs), 0
    identifier = OnlineIdentifier(
        robot, first.space, first.walk.contact_bodies, first.walk.timestep_s, options, first.sensors
    )
    stopped = False
    for log in logs:
        if identifier.converged or stopped:
            break
        if log is not first:
            identifier.start_walk(log.space, log.walk.contact_bodies, log.walk.timestep_s, log.sensors)
        for sample in log.walk.samples():
            pushed += 1
            for window in identifier.push(sample):
                progress(pushed / n_samples, f"window {window.index + 1}")
                stopped = stopped or stop()
            if identifier.converged or stopped:
                break
        identifier.finish()
    progress(1.0, "done")
    result = identifier.result([log.walk.source for log in logs])
    return result.stopped_early() if stopped else result
