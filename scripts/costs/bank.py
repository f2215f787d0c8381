"""One step of a bank of N models against N steps of the engine on the same model, without any Python in between."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import mujoco
import numpy as np

from costs.problem import Problem
from costs.sheet import Sheet, number
from massid.errors import BadInputError
from massid.model.robot import Robot
from massid.observer.bank import RobotBank
from massid.observer.blas import single_threaded
from massid.observer.replay import replay_block
from massid.observer.sensors import NoisySensors
from massid.search.monitoring import MonitoringFilter
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.walk import Segment, Walk

STEPS = 500
RAW_STEPS = 10
"""Steps of the engine from each measured state: without injection it soon flails, which takes another time."""
SPREAD = 0.05
"""Of the models around the centre, in nominal masses."""


@dataclass(frozen=True)
class BankCost:
    """What a bank costs.

    Attributes:
        sensors: clean or noisy.
        n_models: N.
        threads: of the bank.
        raw_us: processor time of one step of the engine [us].
        step_us: processor time of one step of the bank, by model [us].
        processor: of a step of the bank over N steps of the engine.
        wall: likewise, of a step of the bank over N / threads steps of the engine.
        per_second: processor time for a second of the log [s].
    """

    sensors: str
    n_models: int
    threads: int
    raw_us: float
    step_us: float
    processor: float
    wall: float
    per_second: float


@dataclass(frozen=True)
class Clock:
    """Processor and wall time of one sample period of the log [s]."""

    processor_s: float
    wall_s: float


def measure_banks(
    problems: Sequence[Problem], sizes: Sequence[int], threads: Sequence[int], rounds: int
) -> list[BankCost]:
    """Time banks of all sizes and threads and the engine in turns; the best of each counts.

    Raises:
        BadInputError: a log is too short.
    """
    measured = []
    with single_threaded():
        for problem in problems:
            job = problem.prepare()
            log, robot = job.logs[0], job.robot
            walk, space = log.walk, log.space
            window = _middle(walk)
            sensors = log.sensors.suited_to(walk)
            make = partial(sensors.bank, robot, space, walk.contact_bodies, walk.timestep_s, slopes=True)
            banks = {(n, k): make(n, k) for n, k in product(sizes, threads)}
            raw = _Raw(robot, walk, window, smooth=isinstance(sensors, NoisySensors))
            turns = [
                (raw.time(), {key: _time(bank, space, walk, window) for key, bank in banks.items()})
                for _ in range(rounds)
            ]
            best_raw = _best([turn[0] for turn in turns])
            for n, k in banks:
                best = _best([turn[1][n, k] for turn in turns])
                measured.append(
                    BankCost(
                        sensors=problem.name,
                        n_models=n,
                        threads=k,
                        raw_us=1e6 * best_raw.processor_s,
                        step_us=1e6 * best.processor_s / n,
                        processor=best.processor_s / (n * best_raw.processor_s),
                        wall=best.wall_s / (n * best_raw.wall_s / k),
                        per_second=best.processor_s / walk.timestep_s,
                    )
                )
    return measured


def bank_sheet(costs: Sequence[BankCost]) -> Sheet:
    """A row for each bank."""
    return Sheet(
        "A step of the bank over N steps of mj_step of the same model",
        (
            *("log", "models N", "threads", "bank / N mj_step, processor", "bank x threads / N mj_step, wall"),
            *("mj_step, µs", "bank per model, µs", "processor s per s of log"),
        ),
        tuple(
            (
                *(one.sensors, str(one.n_models), str(one.threads), f"{one.processor:.2f}", f"{one.wall:.2f}"),
                *(f"{one.raw_us:.1f}", f"{one.step_us:.1f}", number(one.per_second)),
            )
            for one in costs
        ),
    )


class _Raw:
    """The engine alone, driven as the bank's models are."""

    def __init__(self, robot: Robot, walk: Walk, window: Segment, smooth: bool) -> None:
        self._substeps = robot.steps_in(walk.timestep_s)
        self._model = robot.identification_model(walk.contact_bodies)
        self._model.opt.timestep = walk.timestep_s / self._substeps
        if smooth:
            self._model.dof_frictionloss[:] = 0.0  # as in a noisy log's bank, which is told what friction was
        self._data = mujoco.MjData(self._model)
        self._block = replay_block(walk, robot.layout, window)

    def time(self) -> Clock:
        data, block, starts = self._data, self._block, range(0, STEPS, RAW_STEPS)
        processor_s = wall_s = 0.0
        for k in starts:
            mujoco.mj_resetData(self._model, data)
            data.qpos[:], data.qvel[:], data.ctrl[:] = block.qpos[k], block.qvel[k], block.wrench[k]
            data.qfrc_applied[:] = block.generalised_force(k)
            begin, began = time.perf_counter(), time.process_time()
            mujoco.mj_step(self._model, data, RAW_STEPS)
            processor_s, wall_s = processor_s + time.process_time() - began, wall_s + time.perf_counter() - begin
        each = self._substeps / (len(starts) * RAW_STEPS)
        return Clock(processor_s * each, wall_s * each)


def _time(bank: RobotBank, space: ParameterSpace, walk: Walk, window: Segment) -> Clock:
    """Replay a window and score it, as the search does."""
    n = bank.n_models
    offsets = SPREAD * np.random.default_rng(0).normal(size=(n, len(space)))
    points = space.project(space.nominal * (1.0 + offsets))
    bank.place(points)
    scores = MonitoringFilter(n, walk.timestep_s)
    begin, began = time.perf_counter(), time.process_time()
    for _, errors in bank.replay(walk, window):
        scores.update(errors)
    scores.result(Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * (n - 1))))
    return Clock((time.process_time() - began) / STEPS, (time.perf_counter() - begin) / STEPS)


def _best(clocks: Sequence[Clock]) -> Clock:
    """Least of each: other programs share the machine."""
    return Clock(min(one.processor_s for one in clocks), min(one.wall_s for one in clocks))


def _middle(walk: Walk) -> Segment:
    """So many steps from the middle of the longest stretch without a gap."""
    longest = max(walk.segments, key=len)
    if len(longest) <= STEPS:
        raise BadInputError(
            f"{walk.source}: a bank is timed over {STEPS + 1} samples without a gap, not {len(longest)}."
        )
    start = longest.start + (len(longest) - STEPS - 1) // 2
    return Segment(start, start + STEPS + 1)
