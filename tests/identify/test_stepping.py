"""How many steps models take between samples is read off the log, not off the model file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.identify.stepping import with_suitable_steps
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.observer.sensors import NoisySensors
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about

SIMULATED_S = 1e-3


@pytest.fixture(scope="module")
def simulated() -> Walk:
    """Simulated in steps of a millisecond, shaken, by masses that differ from the model file's."""
    robot = make_robot()
    space = mass_space(robot, LINKS)
    return push_about(robot, space, draw_truth(space, seed=1), seconds=2.0, amplitude=0.15, shaking_nm=20.0)


def _with_step(step_s: float) -> Robot:
    spec = make_robot().spec.copy()
    spec.option.timestep = step_s
    return Robot(spec, "file.xml")


def _logged(walk: Walk, every: int) -> Walk:
    """Every so many samples of a walk, with the means of what acted in between, as noisy sensors read them."""
    count = len(walk) // every
    means = {
        name: getattr(walk, name)[: count * every].reshape(count, every, *getattr(walk, name).shape[1:]).mean(axis=1)
        for name in ("effort", "wrench")
    }
    rows = {name: getattr(walk, name)[: count * every : every] for name in ("stamps_ns", "qpos", "qvel")}
    thinned = replace(walk, timestep_s=walk.timestep_s * every, segments=(), **rows, **means)
    return Sensors(PRESETS["white"], 8, FEET, np.random.default_rng(0)).measure(thinned)


def _chosen(walk: Walk, file_step_s: float) -> tuple[int | None, tuple[str, ...]]:
    robot = _with_step(file_step_s)
    sensors, notes = with_suitable_steps(NoisySensors(PRESETS["white"]), walk, robot, mass_space(robot, LINKS))
    return sensors.steps, notes


@pytest.mark.parametrize("every", [1, 2, 4])
def test_a_file_that_is_right_is_believed(every: int, simulated: Walk) -> None:
    assert _chosen(_logged(simulated, every), SIMULATED_S) == (every, ())


@pytest.mark.parametrize("every", [2, 4])
def test_a_file_with_longer_steps_than_the_log_was_made_with_is_not(every: int, simulated: Walk) -> None:
    steps, notes = _chosen(_logged(simulated, every), every * SIMULATED_S)
    assert steps is not None
    assert 1 < steps <= every
    assert len(notes) == 1
    assert f"explain the readings better than those of {every * SIMULATED_S:g} s, nearest to the model file" in notes[0]


def test_a_walk_of_a_moment_keeps_the_steps_of_its_file(simulated: Walk) -> None:
    rows = {name: getattr(simulated, name)[:200] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    short = replace(simulated, segments=(), **rows)
    assert _chosen(short, SIMULATED_S) == (None, ())
