"""Log the physics steps of any dm_control environment with a floating-base robot in it.

The recorder stands between an environment and its physics: each physics step, also each of the several that make one
control step, is seen with the state before it and the torques and contact forces that acted over it. A slower log has
every so many states, and the means of what acted until the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeAlias

import dm_env
import mujoco
import numpy as np

from massid.errors import BadInputError
from massid.log import WalkWriter
from massid.model.inverse import takes_stages
from massid.plant.backend import PhysicsError
from massid.plant.contacts import ContactRecorder
from massid.plant.effort import effort_meter
from massid.plant.parts import RobotParts
from massid.typing import AnyArray, FloatArray

START_NS = 1_767_225_600_000_000_000
"""First stamp of a simulated walk, the start of 2026: the same seed makes the same log."""

_WHOLE = 1e-6
"""Rounding that is borne in a number of steps."""

COMPLETE, TERMINATED, TRUNCATED, DIVERGED = "complete", "terminated", "truncated", "diverged"
BLOCK_STEPS = 200

Agent: TypeAlias = Callable[[dm_env.TimeStep], AnyArray] | Iterator[AnyArray]
"""Gives the action for what the environment showed last, or one action after the other."""

Progress: TypeAlias = Callable[[float, str], None]
"""Called with the fraction done, 0 to 1, and a few words."""


@dataclass(frozen=True)
class Recording:
    """What was recorded.

    Attributes:
        path: the log.
        samples: in it.
        duration_s: time they cover [s].
        end: "complete"; "terminated" by the task; "truncated" by its time limit or the end of the actions; "diverged".
        self_contact_samples: samples in which the robot's own links pressed on each other: no wrench shows that.
    """

    path: Path
    samples: int
    duration_s: float
    end: str
    self_contact_samples: int

    @property
    def terminated(self) -> bool:
        """Whether the task ended the episode: the robot fell, say."""
        return self.end == TERMINATED


class StepRecorder:
    """Sees the physics steps of one episode and writes them, block by block, until it has enough.

    Args:
        physics: of the environment, after its reset.
        writer: open log.
        parts: the robot in it.
        samples: how many to log; what comes later passes unseen.
        stride: physics steps that make one sample.
        start_ns: first stamp since the Unix epoch [ns].
        progress: told after every block.
    """

    def __init__(
        self,
        physics: Any,
        writer: WalkWriter,
        parts: RobotParts,
        samples: int,
        stride: int = 1,
        start_ns: int = START_NS,
        progress: Progress | None = None,
    ) -> None:
        self._physics, self._writer, self._parts = physics, writer, parts
        self._model: mujoco.MjModel = physics.model.ptr
        self._data: mujoco.MjData = physics.data.ptr
        self._wanted, self._stride, self._start_ns, self._progress = samples, stride, start_ns, progress
        self._period_s = stride * float(self._model.opt.timestep)
        self._effort_meter = effort_meter(self._model)
        self._block = stride * max(1, BLOCK_STEPS // stride)
        self._contacts = ContactRecorder(self._model, parts, self._block)
        self._qpos = np.zeros((self._block, self._model.nq))
        self._qvel = np.zeros((self._block, self._model.nv))
        self._effort = np.zeros((self._block, self._model.nv))
        self._filled = 0
        self._stages = takes_stages(self._model)
        self._instant = mujoco.MjData(self._model) if self._stages else self._data
        self._state = np.empty(mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_INTEGRATION))
        self.samples = 0
        self.self_contact_samples = 0

    @property
    def full(self) -> bool:
        """Whether all samples were seen."""
        return self.samples + self._filled // self._stride >= self._wanted

    def __enter__(self) -> Self:
        self._step = self._physics.step
        self._physics.step = self._step_and_record
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        del self._physics.step
        self._flush()

    def _step_and_record(self, nstep: int = 1) -> None:
        for _ in range(nstep):
            if self.full:
                self._step(1)
            else:
                self._record_step()

    def _record_step(self) -> None:
        physics, data, k = self._physics, self._data, self._filled
        self._qpos[k], self._qvel[k] = data.qpos, data.qvel
        self._effort_meter.before(data)
        if self._stages:
            self._evaluate_first_stage()
        # Legacy steps end by preparing the next one: contacts of the new state beside forces of the old. So step
        # without that end, read, and make it up afterwards.
        legacy = physics.legacy_step
        physics.legacy_step = False
        try:
            self._step(1)
        finally:
            physics.legacy_step = legacy
        self._effort[k] = self._effort_meter.after(self._instant)
        self._contacts.take(k, self._instant)
        if legacy:
            mujoco.mj_step1(self._model, data)
        self._filled += 1
        if self._filled == self._block:
            self._flush()

    def _evaluate_first_stage(self) -> None:
        """Runge-Kutta evaluates forces four times; the log has those at the state before the step."""
        what = mujoco.mjtState.mjSTATE_INTEGRATION
        mujoco.mj_getState(self._model, self._data, self._state, what)
        mujoco.mj_setState(self._model, self._instant, self._state, what)
        mujoco.mj_forward(self._model, self._instant)

    def _flush(self) -> None:
        steps, n = self._filled, self._filled // self._stride
        self._filled = 0
        acted = self._contacts.finish(steps)
        if n == 0:
            return
        parts, whole = self._parts, n * self._stride  # steps after the last whole sample are left out
        qpos, qvel = self._qpos[: whole : self._stride], self._qvel[: whole : self._stride]
        times_s = np.arange(self.samples, self.samples + n) * self._period_s
        self._writer.append_block(
            self._start_ns + np.rint(times_s * 1e9).astype(np.int64),
            parts.log_qpos(qpos),
            parts.log_qvel(qpos, qvel),
            self._mean(self._effort[:whole, parts.joint_dof]),
            {body: self._mean(wrench[:whole]) for body, wrench in acted.wrench.items()},
        )
        self.samples += n
        self.self_contact_samples += int(acted.self_contact[:whole].reshape(n, self._stride).any(axis=1).sum())
        if self._progress is not None:
            self._progress(self.samples / self._wanted, f"{self.samples * self._period_s:.1f} s recorded")

    def _mean(self, values: FloatArray) -> FloatArray:
        """What acted over each sample's steps, on average."""
        if self._stride == 1:
            return values
        return np.asarray(values.reshape(-1, self._stride, values.shape[1]).mean(axis=1))


def record(
    environment: dm_env.Environment,
    agent: Agent,
    path: Path | str,
    duration_s: float,
    *,
    metadata: Mapping[str, str] | None = None,
    root_body: str | None = None,
    contact_bodies: Sequence[str] = (),
    terminated: str = TERMINATED,
    period_s: float | None = None,
    start_ns: int = START_NS,
    companions: Callable[[str], Mapping[Path, bytes]] | None = None,
    progress: Progress | None = None,
) -> Recording:
    """Record one episode of an environment.

    Works with `dm_control.composer` and `dm_control.rl.control` environments (the suite). The environment is reset
    first; the recording ends with the episode if that is shorter. A log exists also after an error, with its reason.

    Args:
        environment: with a robot that floats in it.
        agent: takes the last `TimeStep` and gives the next action; or an iterator over actions.
        path: the log to write, NAME.mcap; replaced if it exists.
        duration_s: how long to record [s].
        metadata: what made the log; integrator, engine and sensor noise ("none") are added.
        root_body: the robot's floating base; None for the floating body with the most joints.
        contact_bodies: bodies that have a wrench topic even if nothing touches them.
        terminated: what the log says when the task ends the episode, such as "fell".
        period_s: of the log's samples, a whole number of physics steps; None for one [s].
        start_ns: first stamp since the Unix epoch [ns].
        companions: asked at the end, and told what the log says of it: files that appear together with the log.
        progress: told where the recording stands.

    Raises:
        BadInputError: the period is not a whole number of physics steps, or the duration is shorter than a period.
        ModelError: no robot to record.
        LogError: the log cannot be written.
    """
    timestep = environment.reset()
    physics: Any = environment.physics
    model: mujoco.MjModel = physics.model.ptr
    stride = _stride(period_s, float(model.opt.timestep))
    timestep_s = stride * float(model.opt.timestep)
    samples = round(duration_s / timestep_s)
    if samples < 1:
        what = "physics step" if stride == 1 else "sample"
        raise BadInputError(f"A recording of {duration_s} s is shorter than one {what} of {timestep_s} s.")
    parts = RobotParts.find(model, root_body)
    writer = WalkWriter(
        path,
        root_body=parts.root_body,
        joint_names=parts.joint_names,
        timestep_s=timestep_s,
        contact_bodies=contact_bodies,
        metadata={**(metadata or {}), **_engine_metadata(model)},
        companions=companions,
    )
    act = agent if callable(agent) else _replayed(agent)
    with writer:
        with StepRecorder(physics, writer, parts, samples, stride, start_ns, progress) as recorder:
            end = COMPLETE
            while not recorder.full:
                try:
                    action = act(timestep)
                except StopIteration:
                    end = TRUNCATED
                    break
                try:
                    timestep = environment.step(action)
                except PhysicsError:
                    end = DIVERGED
                    break
                if timestep.last() and not recorder.full:
                    end = TERMINATED if timestep.discount == 0.0 else TRUNCATED
                    break
        if end != COMPLETE:
            writer.end_because(terminated if end == TERMINATED else end)
        writer.annotate("self_contact_samples", str(recorder.self_contact_samples))
    return Recording(
        path=writer.path,
        samples=recorder.samples,
        duration_s=recorder.samples * timestep_s,
        end=end,
        self_contact_samples=recorder.self_contact_samples,
    )


def _stride(period_s: float | None, timestep_s: float) -> int:
    """Physics steps of one sample."""
    if period_s is None:
        return 1
    steps = period_s / timestep_s
    if not (np.isfinite(steps) and round(steps) >= 1 and abs(steps - round(steps)) < _WHOLE):
        raise BadInputError(
            f"A sample every {period_s:g} s is no whole number of physics steps: the robot's take {timestep_s:g} s."
        )
    return round(steps)


def _replayed(actions: Iterator[AnyArray]) -> Callable[[dm_env.TimeStep], AnyArray]:
    def act(timestep: dm_env.TimeStep) -> AnyArray:
        del timestep
        return next(actions)

    return act


def _engine_metadata(model: mujoco.MjModel) -> dict[str, str]:
    integrator = mujoco.mjtIntegrator(model.opt.integrator).name.removeprefix("mjINT_").lower()
    return {"engine": f"MuJoCo {mujoco.__version__}", "integrator": integrator, "sensor_noise": "none"}
