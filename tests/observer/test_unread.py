"""Wrenches that no sensor reads, in the banks of both sensor models."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.identify import IdentifyOptions
from massid.identify.sensing import with_nuisances
from massid.model.unknowns.unknown import unknowns_of
from massid.observer.bank import RobotBank
from massid.observer.kalman import directions
from massid.observer.sensors import ExactSensors, NoisySensors
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, SensorNoise, Sensors
from tests.conftest import Pushed

WHITE = PRESETS["white"]
STRETCH = Segment(300, 351)
LEFT = tuple(range(6))


def _bank(pushed: Pushed, sensors: NoisySensors | ExactSensors, n_models: int = 2) -> RobotBank:
    walk = pushed.walk
    return sensors.bank(pushed.robot, pushed.space, walk.contact_bodies, walk.timestep_s, n_models, 1)


def _errors(bank: RobotBank, walk: Walk, points: FloatArray) -> FloatArray:
    bank.place(points)
    return np.concatenate([errors.values for _, errors in bank.replay(walk, STRETCH, stop=STRETCH.stop)], axis=1)


def _noisy(walk: Walk, noise: SensorNoise = WHITE) -> Walk:
    return Sensors(noise, len(walk.joint_names), walk.contact_bodies, np.random.default_rng(0)).measure(walk)


@pytest.mark.parametrize("sensors", [NoisySensors(WHITE, open_axes=LEFT), ExactSensors(open_axes=LEFT)])
def test_what_the_unread_wrench_is_taken_for_hardly_matters(
    pushed: Pushed, sensors: NoisySensors | ExactSensors
) -> None:
    """To first order not at all: twice as wrong a wrench leaves errors that are far less than with a sensor."""
    walk = _noisy(pushed.walk)
    push = np.zeros_like(walk.wrench)
    push[:, 0] = [3.0, -5.0, 20.0, 1.0, -1.0, 0.3]
    points = np.vstack([pushed.truth, pushed.space.nominal])
    changes = []
    for one in (sensors, replace(sensors, open_axes=())):
        bank = _bank(pushed, one)
        right, wrong = (_errors(bank, replace(walk, wrench=walk.wrench + more), points) for more in (0.0 * push, push))
        changes.append(np.linalg.norm(wrong - right))
    assert changes[0] < 0.02 * changes[1]


def test_the_limit_is_that_of_noise_without_bounds() -> None:
    """(1 - Q Q^T) L^-1 squared is the inverse of L L^T + s^2 B B^T for a large s."""
    rng = np.random.default_rng(0)
    root, effects = np.tril(rng.normal(size=(6, 6))) + 3.0 * np.eye(6), rng.normal(size=(6, 2))
    whitener = np.linalg.inv(root)
    basis = directions(whitener @ effects)
    blind = whitener - basis @ (basis.T @ whitener)
    limit = np.linalg.inv(root @ root.T + 1e10 * effects @ effects.T)
    np.testing.assert_allclose(blind.T @ blind, limit, atol=1e-6)


def test_errors_that_say_nothing_are_not_counted(pushed: Pushed) -> None:
    bank = _bank(pushed, NoisySensors(WHITE, open_axes=tuple(range(12))))
    bank.place(np.vstack([pushed.truth, pushed.space.nominal]))
    for _, errors in bank.replay(_noisy(pushed.walk), STRETCH, stop=STRETCH.stop):
        np.testing.assert_array_equal(errors.explained, 12)


def test_with_the_true_masses_nothing_is_left_of_a_log_without_noise(pushed: Pushed) -> None:
    bank = _bank(pushed, ExactSensors(open_axes=tuple(range(12))))
    errors = _errors(bank, pushed.walk, np.vstack([pushed.truth, pushed.space.nominal]))
    assert np.abs(errors[0]).max() < 1e-10
    assert np.abs(errors[1]).max() > 1e-4


def test_a_foot_in_the_air_is_not_unknown(pushed: Pushed) -> None:
    walk = replace(_noisy(pushed.walk), wrench=np.zeros_like(pushed.walk.wrench))
    bank = _bank(pushed, NoisySensors(WHITE, open_axes=tuple(range(12))))
    bank.place(np.vstack([pushed.truth, pushed.truth]))
    for _, errors in bank.replay(walk, STRETCH, stop=STRETCH.stop):
        assert errors.explained is not None
        assert not errors.explained.any()


def test_effects_that_are_combinations_of_others_add_no_direction() -> None:
    effects = np.array([[1.0, 0.0, 1.0], [0.0, 1e3, 1e3], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
    basis = directions(effects)
    assert basis.shape == (4, 2)
    np.testing.assert_allclose(basis @ (basis.T @ effects), effects, atol=1e-9)


def test_sensors_that_are_not_there_have_no_errors(pushed: Pushed) -> None:
    walk = replace(pushed.walk, open_axes=LEFT)

    def named(walk: Walk) -> ParameterSpace:
        return with_nuisances(pushed.space, pushed.robot, walk, PRESETS["realistic"], IdentifyOptions())

    missing = set(named(pushed.walk).names) - set(named(walk).names)
    assert len(missing) == 9  # six gains, three offsets of forces
    assert all("l_foot" in name for name in missing)
    blind = unknowns_of(named(replace(walk, open_axes=tuple(range(12)))))
    assert not [one.name for one in blind if "wrench" in one.name]
