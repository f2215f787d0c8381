"""The motion is averaged as far around a sample as its slopes stay those of the samples that have no part in them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from massid.model.unknowns.spaces import mass_space
from massid.observer.averaging import REACHES_S, suitable_reach_s
from massid.observer.spans import REACH_S
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.noise import PRESETS
from tests.pushed_robot import LINKS, make_robot, push_about

NOISE = PRESETS["white"]
SECONDS = 1.5


def _walk(velocity_at: Callable[[FloatArray], FloatArray], seconds: float = SECONDS) -> Walk:
    """A log whose velocities all are this, and noise; nothing else of it is looked at."""
    robot = make_robot()
    space = mass_space(robot, LINKS)
    walk = push_about(robot, space, space.nominal, seconds)
    time_s = np.arange(len(walk)) * walk.timestep_s
    joints = walk.qvel.shape[1] - 6
    std = NOISE.state_std(joints)[6 + joints :]
    noise = std * np.random.default_rng(0).normal(size=walk.qvel.shape)
    return replace(walk, qvel=velocity_at(time_s)[:, None] + noise)


@pytest.mark.parametrize("velocity_at", [np.zeros_like, lambda t: 0.05 * np.sin(2.0 * np.pi * t / 1.5)])
def test_a_robot_that_hardly_moves_bears_a_long_average(velocity_at: Callable[[FloatArray], FloatArray]) -> None:
    assert suitable_reach_s(_walk(velocity_at), NOISE) >= 0.08


@pytest.mark.parametrize(
    "velocity_at",
    [lambda t: 2.0 * np.sin(2.0 * np.pi * 8.0 * t), lambda t: np.where(t % 0.4 < 0.2, 0.5, -0.5)],
    ids=["swings", "impacts"],
)
def test_a_walk_does_not(velocity_at: Callable[[FloatArray], FloatArray]) -> None:
    assert suitable_reach_s(_walk(velocity_at), NOISE) == REACH_S


def test_a_log_too_short_to_tell_gets_that_of_a_walk() -> None:
    assert suitable_reach_s(_walk(np.zeros_like, seconds=2.0 * REACHES_S[-1]), NOISE) == REACH_S
