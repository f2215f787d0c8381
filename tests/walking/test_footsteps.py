from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.errors import BadInputError
from massid.walking import DEFAULT_GAIT, GAITS, Gait, Morphology, find_gait
from massid.walking.footsteps import LEFT, RIGHT, FootPose, FootstepPlanner
from massid.walking.swing import SwingTrajectory, quintic
from tests.walking.floor import nominal

ATLAS = Morphology.from_model(nominal("atlas"))


def planner(gait: Gait, seed: int = 0) -> FootstepPlanner:
    return FootstepPlanner(gait, ATLAS, np.random.default_rng(seed))


@pytest.mark.parametrize("name", [name for name in GAITS if name != "stand"])
def test_feet_alternate_and_never_meet(name: str) -> None:
    steps = planner(GAITS[name])
    stance = FootPose(np.array([0.0, -0.11, 0.0]), 0.0)
    narrowest = sum(sole.half_width_m for sole in ATLAS.soles)
    for index in range(60):
        step = steps.take()
        assert step.side == (LEFT if index % 2 == 0 else RIGHT)
        landing = step.landing(stance)
        across = np.array([-np.sin(stance.yaw_rad), np.cos(stance.yaw_rad)])
        side = 1.0 if step.side == LEFT else -1.0
        assert side * float((landing.position - stance.position)[:2] @ across) > narrowest
        stance = landing


def test_looking_ahead_changes_no_step() -> None:
    curious, plain = planner(GAITS["random"]), planner(GAITS["random"])
    for count in (1, 4, 2, 5, 3):
        assert curious.upcoming(count)[0] == curious.take() == plain.take()


def test_a_gait_with_an_end_runs_out_of_steps() -> None:
    steps = planner(replace(GAITS["straight"], steps=3))
    assert len(steps.upcoming(5)) == 3
    steps.take()
    assert len(steps.upcoming(5)) == 2
    assert not planner(GAITS["stand"]).upcoming(4)


def test_two_sideways_steps_make_the_distance_asked_for() -> None:
    gait = replace(GAITS["sideways"], random_sideways_m=0.0)
    steps = planner(gait)
    start = FootPose(np.array([0.0, -ATLAS.foot_spacing_m / 2, 0.0]), 0.0)
    end = steps.take().landing(start)
    end = steps.take().landing(end)
    assert_allclose(end.position - start.position, [0.0, steps.scale * gait.sideways_m, 0.0], atol=1e-12)


def test_turning_steps_close_a_circle() -> None:
    steps = planner(replace(GAITS["turn"], turn_rad=2 * np.pi / 40, forward_m=0.0))
    pose = FootPose(np.array([0.3, -0.1, 0.0]), 0.2)
    start = pose
    for _ in range(40):
        pose = steps.take().landing(pose)
    assert_allclose(pose.position, start.position, atol=1e-9)
    assert_allclose(pose.yaw_rad, start.yaw_rad + 2 * np.pi)


def test_a_swing_starts_and_ends_at_rest_and_clears_the_floor() -> None:
    start, end = FootPose(np.array([0.0, 0.1, 0.0]), 0.0), FootPose(np.array([0.3, 0.12, 0.0]), 0.2)
    swing = SwingTrajectory(start, end, duration_s=0.6, apex_m=0.07)
    first, last = swing.at(0.0), swing.at(0.6)
    assert_allclose(first.position, start.position)
    assert_allclose(last.position, end.position, atol=1e-12)
    assert_allclose(last.yaw_rad, end.yaw_rad)
    for target in (first, last):
        assert_allclose(np.append(target.velocity, target.yaw_rate), 0.0, atol=1e-12)
    heights = [swing.at(t).position[2] for t in np.linspace(0.0, 0.6, 61)]
    assert_allclose(max(heights), 0.07, atol=1e-12)
    assert swing.at(0.7).position[2] < end.position[2]  # late: it reaches for the floor


def test_swing_rates_are_derivatives() -> None:
    start, end = FootPose(np.array([0.0, 0.1, 0.01]), 0.0), FootPose(np.array([0.3, 0.12, 0.0]), 0.2)
    swing, h = SwingTrajectory(start, end, duration_s=0.6, apex_m=0.07), 1e-5
    for time_s in (0.05, 0.2, 0.4, 0.58):
        before, here, after = (swing.at(t) for t in (time_s - h, time_s, time_s + h))
        # central differences of quintics: errors of h^2 times a third rate of some 100 m/s^3
        assert_allclose((after.position - before.position) / (2 * h), here.velocity, atol=1e-6)
        assert_allclose((after.velocity - before.velocity) / (2 * h), here.acceleration, atol=1e-4)
        assert_allclose((after.yaw_rad - before.yaw_rad) / (2 * h), here.yaw_rate, atol=1e-6)
    assert quintic(-1.0, 0.5) == (0.0, 0.0, 0.0)


def test_gaits_are_found_by_name() -> None:
    assert find_gait(DEFAULT_GAIT) is next(iter(GAITS.values()))
    with pytest.raises(BadInputError, match=r"no gait named 'strait'. Did you mean straight"):
        find_gait("strait")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"single_support_s": 0.0}, "single_support_s is 0.0; it must be above zero"),
        ({"arm_rad": -0.1}, "arm_rad is -0.1; it must not be negative"),
        ({"random_duration": 0.6}, "random_duration is 0.6; it must be below 0.5"),
    ],
)
def test_impossible_gaits_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        replace(GAITS["straight"], **change)
