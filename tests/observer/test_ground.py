from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.model.realisation import Realisation, SensorErrors
from massid.model.robot import Robot
from massid.observer.contact_gate import is_unloaded
from massid.observer.ground import AT_FIRST, MASSES_FOUND, WITHOUT_NOISE, _feet, with_ground
from massid.plant import without_wrenches
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import fly_about

WHITE = PRESETS["white"]


@pytest.fixture(scope="module")
def short(pushed: Pushed) -> Walk:
    return pushed.walk.between(0, 600)


@pytest.fixture(scope="module")
def true(pushed: Pushed) -> Realisation:
    return pushed.robot.realise(pushed.space, pushed.truth, pushed.walk.contact_bodies)


def _loaded(walk: Walk) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(walk.wrench.any(axis=2))


def _measured(walk: Walk, preset: str = "white") -> Walk:
    noise = PRESETS[preset]  # type: ignore[index]
    return Sensors(noise, len(walk.joint_names), walk.contact_bodies, np.random.default_rng(1)).measure(walk)


def test_a_walk_whose_wrenches_were_measured_stays_as_it_is(pushed: Pushed, short: Walk) -> None:
    assert with_ground(short, pushed.robot, None) is short


def test_what_one_foot_carries_follows_from_the_other_one(pushed: Pushed, short: Walk, true: Realisation) -> None:
    """Of logs without noise to rounding; the last sample, after which no step begins, is that before it."""
    half = replace(short, wrench=short.wrench * [[1.0], [0.0]], open_axes=tuple(range(6, 12)))
    found = with_ground(half, pushed.robot, None, WITHOUT_NOISE[-1], true)
    np.testing.assert_allclose(found.wrench[1:-1], short.wrench[1:-1], atol=1e-5)
    np.testing.assert_array_equal(found.wrench[:, 0], short.wrench[:, 0])


@pytest.mark.parametrize("noise", [None, WHITE])
def test_no_load_is_missed_with_the_masses_of_the_file(pushed: Pushed, short: Walk, noise: object) -> None:
    read = short if noise is None else _measured(short)
    found = with_ground(without_wrenches(read), pushed.robot, noise, AT_FIRST)  # type: ignore[arg-type]
    assert not (_loaded(short) & ~_loaded(found)).any()


def test_a_robot_that_falls_has_nothing_under_its_feet(pushed: Pushed, true: Realisation) -> None:
    falls = fly_about(pushed.robot, pushed.space, pushed.truth, seconds=0.2)
    found = with_ground(without_wrenches(falls), pushed.robot, None, MASSES_FOUND, true)
    assert not found.wrench.any()


def test_a_foot_that_the_motion_does_not_tell_of_may_carry(pushed: Pushed, true: Realisation) -> None:
    """Legs of four joints share a load between the feet in ways that noise hides: then neither is in the air."""
    falls = fly_about(pushed.robot, pushed.space, pushed.truth, seconds=0.2)
    found = with_ground(without_wrenches(_measured(falls)), pushed.robot, WHITE, MASSES_FOUND, true)
    assert found.wrench.any(axis=2).all()


def test_known_errors_of_the_torque_sensors_are_taken_off(pushed: Pushed, short: Walk) -> None:
    """As they were found: a knee that reads 20 N m too much would carry a part of the robot."""
    channels = pushed.robot.channels(short.contact_bodies)
    joint = channels.joint("l_knee")
    off = without_wrenches(replace(short, effort=short.effort + 20.0 * np.eye(len(short.joint_names))[joint]))
    sensors = pushed.robot.realise(pushed.space, pushed.truth, short.contact_bodies)
    errors = SensorErrors.none(1, channels)
    errors.effort_offset[0, joint] = 20.0
    right, wrong = (
        with_ground(off, pushed.robot, None, MASSES_FOUND, replace(sensors, sensors=one)) for one in (errors, None)
    )
    vertical = short.wrench[100:-1, :, 2]
    assert np.abs(right.wrench[100:-1, :, 2] - vertical).max() < 0.1
    assert np.abs(wrong.wrench[100:-1, :, 2] - vertical).max() > 10.0


def test_a_foot_without_a_sensor_is_unloaded_where_its_wrench_was_found_to_be_zero() -> None:
    wrench = np.zeros((300, 12))
    wrench[100:200, 8] = 1e-9
    unloaded = is_unloaded(wrench, WHITE, 1e-3, open_axes=range(6, 12))
    assert unloaded[:, 0].all()
    np.testing.assert_array_equal(np.flatnonzero(~unloaded[:, 1]), np.arange(100, 200))


def test_axes_without_a_sensor_have_no_say_where_others_have_one() -> None:
    wrench = np.zeros((300, 6))
    wrench[:, 0] = 1e6
    assert is_unloaded(wrench, WHITE, 1e-3, open_axes=(0, 1)).all()
    assert not is_unloaded(wrench, WHITE, 1e-3, open_axes=(1, 2)).any()


def test_toe_and_heel_are_parts_of_one_foot(pushed: Pushed) -> None:
    """Which of them carries, the motion hardly tells; that none does, it tells well."""
    spec = pushed.robot.spec.copy()
    for side in "lr":
        for part, x in (("toe", 0.15), ("heel", -0.1)):
            body = spec.body(f"{side}_foot").add_body(name=f"{side}_{part}", pos=[x, 0.0, -0.05])
            body.add_geom(size=[0.02, 0.0, 0.0], mass=0.01)
            body.add_joint(name=f"{side}_{part}", axis=[0.0, 1.0, 0.0], stiffness=50.0)
    model = Robot(spec).model
    feet = _feet(model, ("l_foot", "r_foot", "l_toe", "l_heel", "r_heel"))
    left = np.array([1.0, 0.0, 1.0, 1.0, 0.0])
    np.testing.assert_array_equal(feet, np.outer(left, left) + np.outer(1.0 - left, 1.0 - left))
    np.testing.assert_array_equal(_feet(model, ("l_toe", "l_heel", "r_toe")), [[1, 1, 0], [1, 1, 0], [0, 0, 1]])
    np.testing.assert_array_equal(_feet(model, ("torso", "l_foot")), np.eye(2))
