from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from massid.errors import BadInputError
from massid.identify import IdentifyOptions
from massid.identify.sensing import estimate_white_noise, read_noise
from massid.model.unknowns.spaces import mass_space
from massid.observer.replay import replay_block
from massid.observer.sensors import NoisySensors
from massid.result import Status
from massid.search.guided import SearchOptions
from massid.search.monitoring import MonitoringFilter
from massid.search.parameters import ParameterSpace
from massid.search.proposal import Proposal, Role
from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray
from massid.walk import Segment, Walk
from massid.walk.noise import PRESETS, SensorNoise, Sensors, rotate
from tests.conftest import Pushed
from tests.pushed_robot import FEET, LINKS, cut, draw_truth, make_robot, push_about, stamped_late
from tests.weighed import weigh_offline, weigh_online

TRUE = PRESETS["white"]
WHITE = IdentifyOptions(dwell_s=0.25, noise="white", other_links=0.0, link_inertia=0.0, lag_s=0.0)


def _measured(pushed: Pushed, preset: str = "white", seed: int = 0) -> Walk:
    rng = np.random.default_rng(seed)
    noise = PRESETS[preset]  # type: ignore[index]
    return Sensors(noise, len(pushed.walk.joint_names), pushed.walk.contact_bodies, rng).measure(pushed.walk)


def test_presets_are_ordered_and_clean_is_zero() -> None:
    for entry in fields(SensorNoise):
        levels = [getattr(PRESETS[name], entry.name) for name in ("clean", "white", "realistic", "harsh")]
        assert levels[0] == 0.0
        assert levels == sorted(levels)


def test_clean_sensors_change_nothing(pushed: Pushed) -> None:
    clean = _measured(pushed, "clean")
    np.testing.assert_allclose(clean.qpos, pushed.walk.qpos, atol=1e-15)
    np.testing.assert_array_equal(clean.wrench, pushed.walk.wrench)


def test_orientations_are_turned_by_what_is_asked_for() -> None:
    rng = np.random.default_rng(0)
    quaternion = rng.normal(size=(50, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    turned = rotate(quaternion, np.full((50, 3), [0.0, 0.0, 0.01]))
    cosine = np.abs(np.sum(quaternion * turned, axis=1))
    np.testing.assert_allclose(2.0 * np.arccos(np.clip(cosine, 0.0, 1.0)), 0.01, rtol=1e-6)


def test_white_noise_levels_are_read_off_the_log(pushed: Pushed) -> None:
    found, true = estimate_white_noise(_measured(pushed)), PRESETS["white"]
    for name in ("joint_position", "joint_velocity", "effort", "base_position", "base_orientation", "force", "moment"):
        assert getattr(found, name) == pytest.approx(getattr(true, name), rel=0.25), name


@pytest.mark.parametrize("every", [1, 5])
def test_a_clean_log_is_recognised_at_any_rate(every: int, pushed: Pushed) -> None:
    rows = {name: getattr(pushed.walk, name)[::every] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    walk = replace(pushed.walk, timestep_s=0.001 * every, segments=(), **rows)
    assert read_noise(walk, pushed.robot) is None


def test_shaking_that_the_torques_explain_is_not_noise(pushed: Pushed) -> None:
    walk = push_about(pushed.robot, pushed.space, pushed.truth, seconds=0.4, shaking_nm=10.0)
    assert estimate_white_noise(walk).joint_velocity > 0.01
    assert read_noise(walk, pushed.robot) is None
    found = read_noise(Sensors(PRESETS["white"], 8, FEET, np.random.default_rng(1)).measure(walk), pushed.robot)
    assert found is not None
    assert found.joint_velocity == pytest.approx(PRESETS["white"].joint_velocity, rel=0.5)


def test_an_impossible_noise_level_is_refused() -> None:
    with pytest.raises(BadInputError, match=r"Noise force is -1\.0; it must not be negative"):
        SensorNoise(force=-1.0)


@pytest.mark.parametrize("identify", [weigh_online, weigh_offline])
def test_truth_lies_within_a_few_deviations(identify, pushed: Pushed) -> None:  # type: ignore[no-untyped-def]
    result = identify(_measured(pushed), pushed.robot, pushed.space, replace(WHITE, dwell_s=0.2))
    assert result.uncertainty is not None
    deviations = np.abs(result.estimate - pushed.truth) / result.uncertainty.std
    assert deviations.max() < 4.0
    assert np.all(result.uncertainty.std < 0.1 * pushed.space.nominal)
    assert result.status is Status.CONVERGED
    assert [window.index for window in result.windows] == list(range(len(result.windows)))


def test_errors_are_as_large_as_the_deviations_say() -> None:
    """Over several noisy logs, squared errors in units of the covariance average to one per parameter."""
    robot = make_robot()
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=5, relative_error=0.02)
    walk = push_about(robot, space, truth, seconds=0.6, seed=2)
    squares = []
    for seed in range(6):
        sensors = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(seed))
        result = weigh_offline(sensors.measure(walk), robot, space, replace(WHITE, passes=3, dwell_s=0.1))
        assert result.uncertainty is not None
        error = result.estimate - truth
        squares.append(error @ np.linalg.solve(result.uncertainty.covariance, error) / len(space))
        assert result.uncertainty.chi2_per_sample == pytest.approx(1.0, abs=0.05)
    assert 0.5 < np.mean(squares) < 1.6  # 42 degrees of freedom: 1 +- 0.22


def test_offsets_are_estimated_beside_the_masses(pushed: Pushed) -> None:
    """A torque sensor that reads 1.5 N m too much on one knee: found as such, and the masses stay right."""
    walk = _measured(pushed)
    effort = walk.effort.copy()
    effort[:, walk.joint_names.index("l_knee")] += 1.5
    spoilt = replace(walk, effort=effort)
    result = weigh_offline(spoilt, pushed.robot, pushed.space, replace(WHITE, noise="realistic"))
    assert result.uncertainty is not None
    names = [parameter.name for parameter in result.uncertainty.nuisances]
    knee = names.index("effort_offset/l_knee")
    assert result.uncertainty.nuisance_estimate[knee] > 0.5
    assert np.abs((result.estimate - pushed.truth) / result.uncertainty.std).max() < 4.0


def test_times_by_which_inputs_are_stamped_late_are_estimated_beside_the_masses(pushed: Pushed) -> None:
    true_s = np.array([1e-3, 5e-4])
    late = replace(pushed, walk=stamped_late(pushed.walk, *true_s))
    options = replace(WHITE, dwell_s=0.2, bank_size=12, lag_s=5e-4)
    result = weigh_offline(_measured(late), pushed.robot, pushed.space, options)
    found = result.uncertainty
    assert found is not None
    assert np.abs((result.estimate - pushed.truth) / found.std).max() < 4.0
    assert [parameter.name for parameter in found.nuisances] == ["effort_lag/all", "wrench_lag/all"]
    assert np.all(np.abs(found.nuisance_estimate - true_s) < 3.0 * found.nuisance_std)
    assert np.all(found.nuisance_std < 2e-4)
    assert found.inflation < 1.3  # without them it is 1.5 to 2.5


def test_links_that_were_not_asked_for_widen_the_intervals(pushed: Pushed) -> None:
    space = mass_space(pushed.robot, ["torso", "l_thigh"])
    walk = _measured(pushed)
    exact = weigh_offline(walk, pushed.robot, space, WHITE)
    unsure = weigh_offline(walk, pushed.robot, space, replace(WHITE, other_links=0.1))
    assert exact.uncertainty is not None
    assert unsure.uncertainty is not None
    one, other = (np.sqrt(np.diagonal(r.covariance) / r.inflation) for r in (exact.uncertainty, unsure.uncertainty))
    assert np.all(other > one)
    assert [p.name for p in unsure.uncertainty.nuisances] == [
        f"mass/{link}" for link in pushed.robot.links if link not in ("torso", "l_thigh")
    ]


def test_json_has_intervals(pushed: Pushed) -> None:
    document = weigh_offline(_measured(pushed), pushed.robot, pushed.space, replace(WHITE, passes=2)).to_json()
    torso = document["links"]["torso"]
    low, high = torso["interval95_kg"]
    assert low < torso["estimate_kg"] < high
    assert high - low == pytest.approx(2 * 1.96 * torso["std_kg"], rel=1e-3)


def _quadratic(walk: Walk, pushed: Pushed, told: SensorNoise) -> LocalQuadratic:
    """Of a whole log, around the true masses, with the noise that the estimator is told."""
    space, truth = pushed.space, pushed.truth
    points = np.vstack([truth, truth + 1e-3 * np.diag(space.scale)])
    proposal = Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * len(space)))
    bank = NoisySensors(told).bank(pushed.robot, space, walk.contact_bodies, walk.timestep_s, len(points))
    bank.place(points)
    block = replay_block(walk, pushed.robot.layout, Segment(0, len(walk)))
    bank.restart(block)
    scores = MonitoringFilter(len(points), walk.timestep_s)
    scores.update(bank.advance(block))
    return scores.result(proposal).window_quadratic()


@pytest.mark.parametrize("factor", [1.0 / 1.5, 1.5])
def test_the_expected_score_of_the_true_masses_is_zero_at_wrong_noise_levels(factor: float, pushed: Pushed) -> None:
    """Columns that share no noise with the output error leave the estimate unbiased, however large noise is said to be.

    The score is the slope of minus half mu, in units of its own deviation over logs that differ in their noise alone.
    """
    told = replace(TRUE, effort=factor * TRUE.effort, force=factor * TRUE.force, moment=factor * TRUE.moment)
    n_logs, clean = 24, cut(pushed.walk, slice(600, 1000))
    scores = np.zeros((n_logs, len(pushed.space)))
    for seed in range(n_logs):
        measured = Sensors(TRUE, 8, FEET, np.random.default_rng(seed)).measure(clean)
        scores[seed] = -0.5 * _quadratic(measured, pushed, told).gradient
    bias = scores.mean(axis=0) / scores.std(axis=0, ddof=1)
    assert np.abs(bias).max() < 3.0 / np.sqrt(n_logs)


@pytest.mark.parametrize("loss_nm", [0.3, 3.0])
def test_friction_loss_under_noise_leaves_the_masses_within_their_deviations(loss_nm: float) -> None:
    """Engines that are shaken by noise would lose friction and find masses that make up for it."""
    robot = make_robot(friction_loss=loss_nm)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=5, relative_error=0.05)
    walk = push_about(robot, space, truth, seconds=1.0, seed=2, amplitude=0.12)
    squares = []
    for seed in range(3):
        measured = Sensors(TRUE, 8, FEET, np.random.default_rng(seed)).measure(walk)
        result = weigh_offline(measured, robot, space, replace(WHITE, dwell_s=0.2, bank_size=12))
        assert result.uncertainty is not None
        assert np.all(result.uncertainty.std < 0.02 * space.nominal)
        error = result.estimate - truth
        squares.append(error @ np.linalg.solve(result.uncertainty.covariance, error) / len(space))
    assert 0.4 < np.mean(squares) < 1.6  # 21 degrees of freedom: 1 +- 0.31


def test_friction_that_is_told_right_leaves_no_error_of_its_own() -> None:
    """Joints that stick and slide, sensors without noise: nothing is left but what an estimate in doubt throws away."""
    robot = make_robot(friction_loss=3.0)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=5, relative_error=0.05)
    walk = push_about(robot, space, truth, seconds=1.0, seed=2, amplitude=0.12)
    result = weigh_offline(walk, robot, space, replace(WHITE, dwell_s=0.2, bank_size=12))
    assert result.uncertainty is not None
    assert np.all(np.abs(result.estimate - truth) < 0.25 * result.uncertainty.std)


class Away:
    """Leads away from the masses, a little in every pass."""

    second_order = True

    def __init__(self, step: FloatArray) -> None:
        self._step = step

    def step(self, quadratic: LocalQuadratic, space: ParameterSpace) -> FloatArray:
        return np.pad(self._step, (0, len(space) - len(self._step)))


def test_a_search_that_makes_it_worse_pass_by_pass_has_not_converged_and_says_so(pushed: Pushed) -> None:
    away = SearchOptions(direction=Away(0.5 * (pushed.space.nominal - pushed.truth)))
    options = replace(WHITE, dwell_s=0.5, search=away, passes=4)
    result = weigh_offline(_measured(pushed), pushed.robot, pushed.space, options)
    assert result.status is not Status.CONVERGED
    assert any("worse than the best one did" in line for line in result.warnings)


def test_a_search_that_comes_to_rest_does_not_run_away(pushed: Pushed) -> None:
    result = weigh_offline(_measured(pushed), pushed.robot, pushed.space, WHITE)
    assert result.status is Status.CONVERGED
    assert not any("worse than the best one did" in line for line in result.warnings)


def test_near_the_root_the_centre_alone_tells_what_the_bank_tells(
    pushed: Pushed, monkeypatch: pytest.MonkeyPatch
) -> None:
    walk = _measured(pushed)
    short = weigh_offline(walk, pushed.robot, pushed.space, WHITE)
    monkeypatch.setattr("massid.identify.likelihood.NEAR", 0.0)
    long = weigh_offline(walk, pushed.robot, pushed.space, WHITE)
    assert len(short.windows[-1].roles) == 1
    assert min(len(one.roles) for one in long.windows) > 1
    assert short.status is long.status is Status.CONVERGED
    assert short.uncertainty is not None
    assert long.uncertainty is not None
    assert np.all(np.abs(short.estimate - long.estimate) < 0.1 * long.uncertainty.std)
    np.testing.assert_allclose(short.uncertainty.std, long.uncertainty.std, rtol=0.02)


def test_a_search_that_is_stopped_on_its_way_says_how_far_it_had_to_go(pushed: Pushed) -> None:
    walk = _measured(pushed)
    short = weigh_offline(walk, pushed.robot, pushed.space, replace(WHITE, passes=2))
    assert short.status is Status.NOT_CONVERGED
    assert any("has not come to rest" in line for line in short.warnings)
    assert short.uncertainty is not None
    assert np.all(np.abs(short.estimate - pushed.truth) < 3.0 * short.uncertainty.std)


def test_threads_do_not_matter_to_the_bit(pushed: Pushed) -> None:
    walk = _measured(pushed)
    one, two = (weigh_offline(walk, pushed.robot, pushed.space, replace(WHITE, passes=2, threads=n)) for n in (1, 2))
    np.testing.assert_array_equal(one.estimate, two.estimate)
    assert one.uncertainty is not None
    assert two.uncertainty is not None
    np.testing.assert_array_equal(one.uncertainty.covariance, two.uncertainty.covariance)


def test_a_noisy_log_gives_the_same_bits_with_any_number_of_threads(pushed: Pushed) -> None:
    """Of the bank, and of BLAS."""
    walk, found = _measured(pushed), []
    for threads in (1, 2):
        with threadpool_limits(threads):
            result = weigh_online(walk, pushed.robot, pushed.space, replace(WHITE, threads=threads))
        assert result.uncertainty is not None
        found.append((result.estimate.tobytes(), result.uncertainty.covariance.tobytes()))
    assert found[0] == found[1]
