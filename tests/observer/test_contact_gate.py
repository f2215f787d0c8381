from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.observer.contact_gate import is_unloaded, offsets_in_air
from massid.observer.spans import Spans
from massid.typing import FloatArray
from massid.walk.noise import PRESETS, SensorNoise

NOISE = PRESETS["realistic"]
N = 2000
TIMESTEP_S = 1e-3


def _readings(noise: SensorNoise, seed: int) -> FloatArray:
    """Two feet in the air, whose force sensors have the offsets and the noise that they are said to have."""
    rng = np.random.default_rng(seed)
    offset = rng.uniform(-2.0, 2.0, 12) * np.tile(np.repeat([noise.force_offset, 0.0], 3), 2)
    return offset + np.tile(noise.wrench_std(), 2) * rng.normal(size=(N, 12))


@pytest.mark.parametrize("period_s", [1e-3, 5e-3])
@pytest.mark.parametrize("preset", ["white", "realistic", "harsh"])
def test_a_foot_in_the_air_counts_as_unloaded(preset: str, period_s: float) -> None:
    shares = [is_unloaded(_readings(PRESETS[preset], seed), PRESETS[preset], period_s).mean() for seed in range(5)]  # type: ignore[index]
    assert np.mean(shares) > 0.98


@pytest.mark.parametrize(("axis", "load"), [(2, 20.0), (0, -20.0), (4, 0.3), (5, -0.3)])  # of 4 N and 0.1 N m
def test_one_loaded_axis_is_enough_and_the_other_foot_has_no_part_in_it(axis: int, load: float) -> None:
    wrench = _readings(PRESETS["white"], 0)
    clear = is_unloaded(wrench, NOISE, TIMESTEP_S)
    wrench[:, 6 + axis] += load
    unloaded = is_unloaded(wrench, NOISE, TIMESTEP_S)
    assert not unloaded[:, 1].any()
    np.testing.assert_array_equal(unloaded[:, 0], clear[:, 0])


@pytest.mark.parametrize("period_s", [1e-3, 2e-3, 5e-3])
def test_a_foot_is_loaded_until_it_has_settled_and_before_a_touchdown_can_show(period_s: float) -> None:
    wrench = np.zeros((400, 6))
    wrench[:100, 2] = wrench[300:, 2] = 1e6
    unloaded = is_unloaded(wrench, NOISE, period_s)[:, 0]
    spans = Spans.at(period_s)
    air = np.flatnonzero(unloaded)
    assert air[0] == 100 + spans.half_width + spans.settling
    assert air[-1] == 300 - spans.half_width - 1
    assert unloaded[air[0] : air[-1]].all()


def test_only_readings_in_units_of_the_noise_matter() -> None:
    wrench = _readings(NOISE, 1)
    wrench[:, 2] += 12.0 * np.sin(np.arange(N) / 100.0)
    unloaded = is_unloaded(wrench, NOISE, TIMESTEP_S)
    assert 0.1 < unloaded[:, 0].mean() < 0.9
    np.testing.assert_array_equal(is_unloaded(8.0 * wrench, NOISE.scaled(8.0), TIMESTEP_S), unloaded)


@pytest.mark.parametrize("seed", range(3))
def test_a_light_load_is_told_from_an_offset_of_its_size(seed: int) -> None:
    wrench = _readings(NOISE, seed)
    bearing = np.arange(N) % 500 < 150  # a heel that touches the ground with 6 N for a while in every step
    wrench[bearing, 2] += 6.0
    assert is_unloaded(wrench, NOISE, TIMESTEP_S)[bearing, 0].any()  # for it may be that much off
    offsets = offsets_in_air(wrench, NOISE, TIMESTEP_S, 0.02)
    unloaded = is_unloaded(wrench, NOISE, TIMESTEP_S, offsets)[:, 0]
    assert not unloaded[bearing & np.roll(bearing, 20) & np.roll(bearing, -20)].any()
    assert unloaded.mean() > 0.5
    truth = _readings(replace(NOISE, force=0.0, moment=0.0), seed)[0]
    np.testing.assert_array_less(np.abs(offsets.mean - truth)[[0, 1, 2, 6, 7, 8]], 4.0 * NOISE.force / np.sqrt(0.5 * N))


def test_what_a_foot_reads_that_never_leaves_the_ground_says_nothing_of_its_offset() -> None:
    wrench = _readings(NOISE, 0)
    wrench[:, :6] += 300.0
    offsets = offsets_in_air(wrench, NOISE, TIMESTEP_S, 0.02)
    np.testing.assert_allclose(offsets.std[:3], NOISE.force_offset)
    np.testing.assert_array_equal(offsets.mean[:3], 0.0)
    assert (offsets.std[6:9] < 0.05 * NOISE.force_offset).all()


def test_no_samples_and_no_contacts_give_empty_answers() -> None:
    assert is_unloaded(np.zeros((0, 12)), NOISE, TIMESTEP_S).shape == (0, 2)
    assert is_unloaded(np.zeros((30, 0)), NOISE, TIMESTEP_S).shape == (30, 0)
    assert offsets_in_air(np.zeros((0, 12)), NOISE, TIMESTEP_S, 0.02).mean.shape == (12,)
