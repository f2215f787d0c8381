"""mujoco.sysid on the same logs: short rollouts from measured states, and our output injection as its rollout.

Needs `pip install "mujoco[sysid]"`. Its Levenberg-Marquardt search starts from the nominal masses; residuals are
weighted by the deviations of ordinary sensors, and measured torques and wrenches drive the model as they drive ours.
"""

from __future__ import annotations

import contextlib
import copy
import io
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from massid.errors import BadInputError
from massid.model.edit import WRENCH_SITE_PREFIX, bare_spec, make_plain_motor
from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.observer.bank import RobotBank
from massid.observer.replay import replay_block
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS

CHUNK_STEPS = 50
OBSERVED_STEPS = 500
"""Steps of a rollout without and with output injection."""
MODELS_KEPT = 32


@dataclass(frozen=True)
class Weighed:
    """What mujoco.sysid found.

    Attributes:
        estimate: shape (n_p,) [kg].
        half_width: of its 95 % intervals, shape (n_p,) [kg].
        wall_s: time it took [s].
    """

    estimate: FloatArray
    half_width: FloatArray
    wall_s: float


def weigh_by_chunks(walk: Walk, robot: Robot, space: ParameterSpace, threads: int = 0) -> Weighed:
    """Roll out chunks of 50 samples from their measured first states."""
    problem = _Problem(walk, robot, space, CHUNK_STEPS)
    return _optimise(problem, space, None, problem.state_error, threads)


def weigh_by_observer(walk: Walk, robot: Robot, space: ParameterSpace, threads: int = 0) -> Weighed:
    """Roll out windows of 0.5 s by identification models that are pulled towards the measurement."""
    problem = _Problem(walk, robot, space, OBSERVED_STEPS)
    return _optimise(problem, space, _Observer(problem, threads), problem.whiten_observed, threads)


def _optimise(
    problem: _Problem,
    space: ParameterSpace,
    rollout: Callable[..., Any] | None,
    error: Callable[..., FloatArray],
    threads: int,
) -> Weighed:
    sysid = load_sysid()
    started = time.perf_counter()
    parameters = sysid.ParameterDict()
    for p in space.parameters:
        parameters.add(sysid.Parameter(p.name, p.nominal, p.lower, p.upper))

    def modify(
        params: Any, predicted: Any, measured: Any, model: Any, return_all: bool, *, state: Any, **_: Any
    ) -> Any:
        return error(state, measured), measured, measured

    residual = sysid.build_residual_fn(
        models_sequences=[problem.sequences(sysid)],
        build_model=lambda params, _: problem.model_at(params.as_vector()),
        modify_residual=modify,
        custom_rollout=rollout,
        n_threads=threads or os.cpu_count(),
        resample_true=False,
    )
    with contextlib.redirect_stdout(io.StringIO()):  # its solver prints every iteration
        found, result = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False)
    residuals, _, _ = residual(found.as_vector(), found)
    _, half_width = sysid.calculate_intervals(residuals, result.jac)
    return Weighed(np.array(found.as_vector()), np.array(half_width), time.perf_counter() - started)


def load_sysid() -> Any:
    """The package, with its warnings off.

    Raises:
        BadInputError: it is not installed.
    """
    from absl import logging
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):  # without its extras the package imports, but is empty
        raise BadInputError('mujoco.sysid is not installed: pip install "mujoco[sysid]"')
    logging.set_verbosity(logging.ERROR)
    return sysid


class _Problem:
    """A walk in the form that mujoco.sysid takes: controls are joint torques and wrenches."""

    def __init__(self, walk: Walk, robot: Robot, space: ParameterSpace, steps: int) -> None:
        self.walk, self.robot, self.space = walk, robot, space
        self.windows = [
            Segment(start, start + steps + 1)
            for segment in walk.segments
            for start in range(segment.start, segment.stop - steps, steps)
        ]
        self._models: dict[bytes, mujoco.MjModel] = {}
        n_v = 6 + len(robot.joint_names)
        std = PRESETS["white"].state_std(len(robot.joint_names))
        self.std = np.concatenate([robot.layout.to_qvel(std[:n_v]), robot.layout.to_qvel(std[n_v:])])

    @cached_property
    def spec(self) -> mujoco.MjSpec:
        """The robot without contacts, with a motor on every joint and six on every foot."""
        spec = bare_spec(self.robot.spec)
        for joint in self.robot.joint_names:
            self._add_motor(spec, mujoco.mjtTrn.mjTRN_JOINT, joint, 0)
        for body in self.walk.contact_bodies:
            site = spec.body(body).add_site(name=f"{WRENCH_SITE_PREFIX}{body}")
            for axis in range(6):
                self._add_motor(spec, mujoco.mjtTrn.mjTRN_SITE, site.name, axis)
        spec.option.timestep = self.walk.timestep_s
        return spec

    @staticmethod
    def _add_motor(spec: mujoco.MjSpec, kind: mujoco.mjtTrn, target: str, axis: int) -> None:
        motor = spec.add_actuator(name=f"{target}/{axis}", trntype=kind, target=target, gear=np.eye(6)[axis])
        make_plain_motor(motor)

    @cached_property
    def _model(self) -> mujoco.MjModel:
        return self.spec.compile()

    def model_at(self, point: FloatArray) -> mujoco.MjModel:
        """The model with other masses; mujoco.sysid asks for the same ones anew for every window."""
        key = point.tobytes()
        if key not in self._models:
            if len(self._models) > MODELS_KEPT:
                self._models.clear()
            self._models[key] = copy.copy(self._model)
            write_fields(self._models[key], self.robot.realise(self.space, point))
        return self._models[key]

    def sequences(self, sysid: Any) -> Any:
        """All windows: first states, controls and measured states."""
        walk, layout = self.walk, self.robot.layout
        qpos, qvel = layout.to_qpos(walk.qpos), layout.to_qvel(walk.qvel)
        control = np.hstack([walk.effort, walk.wrench.reshape(len(walk), -1)])
        measured = np.hstack([qpos, qvel])
        times = np.arange(len(walk)) * walk.timestep_s
        rows = [slice(window.start, window.stop) for window in self.windows]
        return sysid.ModelSequences(
            "walk",
            self.spec,
            [f"{row.start}" for row in rows],
            [sysid.create_initial_state(self._model, qpos[row.start], qvel[row.start]) for row in rows],
            [sysid.TimeSeries(times[row], control[row]) for row in rows],
            [sysid.TimeSeries(times[row], measured[row]) for row in rows],
            allow_missing_sensors=True,
        )

    def state_error(self, state: FloatArray, measured: Any) -> FloatArray:
        """Predicted (time, qpos, qvel) less measured states, in deviations, shape (n, 2 nv)."""
        layout, model = self.robot.layout, self._model
        predicted_qpos, predicted_qvel = state[:, 1 : 1 + model.nq], state[:, 1 + model.nq : 1 + model.nq + model.nv]
        qpos, qvel = measured.data[1:, : model.nq], measured.data[1:, model.nq :]
        turn = slice(layout.root_qpos + 3, layout.root_qpos + 7)
        out = np.empty((len(state), 2 * model.nv))
        out[:, layout.root_dof : layout.root_dof + 3] = (predicted_qpos - qpos)[:, layout.root_qpos :][:, :3]
        out[:, layout.root_dof + 3 : layout.root_dof + 6] = _small_turn(qpos[:, turn], predicted_qpos[:, turn])
        out[:, layout.joint_dof] = (predicted_qpos - qpos)[:, layout.joint_qpos]
        out[:, model.nv :] = predicted_qvel - qvel
        return out / self.std

    def whiten_observed(self, state: FloatArray, measured: Any) -> FloatArray:
        """Output errors that the observer left where states are expected, in deviations, shape (n, 2 nv)."""
        return np.asarray(state[:, 1:] / self.std)


def _small_turn(first: FloatArray, second: FloatArray) -> FloatArray:
    """Rotation vectors from one attitude (wxyz) to another nearby, in the frame of the first, shape (n, 3)."""
    w, vector = first[:, :1], first[:, 1:]
    difference = w * second[:, 1:] - second[:, :1] * vector - np.cross(vector, second[:, 1:])
    return np.asarray(2.0 * np.sign(np.sum(first * second, axis=1))[:, None] * difference)


class _Observer:
    """Our identification models as a rollout of mujoco.sysid; output errors stand in the place of states."""

    def __init__(self, problem: _Problem, threads: int) -> None:
        self._problem, self._threads = problem, threads
        walk = problem.walk
        self._blocks = [replay_block(walk, problem.robot.layout, window) for window in problem.windows]
        self._banks: dict[int, RobotBank] = {}
        self._next = 0

    def __call__(self, *, models: Any, control_signal: Any, initial_states: Any, param_dicts: Any, **_: Any) -> Any:
        from mujoco.sysid import SystemTrajectory, TimeSeries

        points = np.array([params.as_vector() for params in param_dicts])
        # Called for one window at a time, in order.
        errors = self._run(points, self._which(control_signal[0].times[0]))
        times = control_signal[0].times[1:]
        nothing = TimeSeries(times, np.zeros((len(times), 0)))
        return [
            SystemTrajectory(
                model=model,
                control=control,
                sensordata=nothing,
                initial_state=initial,
                state=TimeSeries(times, np.hstack([times[:, None], values])),
            )
            for model, control, initial, values in zip(models, control_signal, initial_states, errors, strict=True)
        ]

    def _which(self, time_s: float) -> int:
        start = round(time_s / self._problem.walk.timestep_s)
        return [window.start for window in self._problem.windows].index(start)

    def _run(self, points: FloatArray, window: int) -> Sequence[FloatArray]:
        problem = self._problem
        if len(points) not in self._banks:
            self._banks[len(points)] = RobotBank(
                problem.robot, problem.space, problem.walk.contact_bodies, len(points),
                timestep_s=problem.walk.timestep_s, n_threads=self._threads,
            )  # fmt: skip
        bank = self._banks[len(points)]
        bank.place(points)
        bank.restart(self._blocks[window])
        return list(bank.advance(self._blocks[window]).values)
