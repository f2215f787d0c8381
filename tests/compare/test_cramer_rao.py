from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.compare import Bound, cramer_rao
from massid.compare.sensitivity import SensitivityRecursion
from massid.errors import BadInputError
from massid.identify import IdentifyOptions
from massid.model.unknowns.bodies import InertiaScale
from massid.model.unknowns.lags import EffortLag, WrenchLag
from massid.model.unknowns.sensors import EffortOffset, EncoderOffset, WrenchGain, WrenchOffset
from massid.model.unknowns.unknown import nuisance
from massid.observer.sensors import NoisySensors
from massid.search.parameters import Parameter, ParameterSpace
from massid.walk import Walk
from massid.walk.noise import PRESETS, SensorNoise, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import make_robot
from tests.weighed import weigh_offline

WHITE = PRESETS["white"]


def _first(walk: Walk, samples: int) -> Walk:
    fields = {name: getattr(walk, name)[:samples] for name in ("stamps_ns", "qpos", "qvel", "effort", "wrench")}
    return replace(walk, segments=(), **fields)


def _bound(
    pushed: Pushed, samples: int = 300, *others: Parameter, noise: SensorNoise = WHITE, gate: bool = True
) -> Bound:
    space = ParameterSpace((*pushed.space.parameters, *others))
    truth = np.concatenate([pushed.truth, [parameter.nominal for parameter in others]])
    return cramer_rao(_first(pushed.walk, samples), pushed.robot, space, truth, noise, gate=gate)


def test_information_is_that_of_all_measurements_taken_at_once() -> None:
    """Stack x_0 (unknown) and p on one side, all measurements on the other: weighted least squares."""
    rng = np.random.default_rng(0)
    n_x, n_p, n = 3, 2, 6
    steps = [0.5 * rng.normal(size=(n_x, n_x)) for _ in range(n)]
    roots = [rng.normal(size=(n_x, n_x)) for _ in range(n)]
    effects = [rng.normal(size=(n_x, n_p)) for _ in range(n)]
    from_output, variance = rng.normal(size=(n_x, n_p)), rng.uniform(0.5, 2.0, n_x)
    recursion = SensitivityRecursion(from_output, variance)
    state, from_p, from_noise = np.eye(n_x), np.zeros((n_x, n_p)), np.zeros((n_x, n * n_x))
    rows, noise = [np.hstack([state, from_p + from_output])], [from_noise]
    for k in range(n):
        recursion.step(steps[k], roots[k] @ roots[k].T, effects[k])
        state, from_p, from_noise = steps[k] @ state, steps[k] @ from_p + effects[k], steps[k] @ from_noise
        from_noise[:, k * n_x : (k + 1) * n_x] += roots[k]
        rows.append(np.hstack([state, from_p + from_output]))
        noise.append(from_noise)
    design, spread = np.vstack(rows), np.vstack(noise)
    covariance = spread @ spread.T + np.diag(np.tile(variance, n + 1))
    expected = np.linalg.inv(design.T @ np.linalg.solve(covariance, design))[n_x:, n_x:]
    np.testing.assert_allclose(np.linalg.inv(recursion.information), expected, rtol=1e-9)


def test_an_input_of_which_nothing_is_known_is_one_more_unknown_of_every_step() -> None:
    """Taken at once: a column of its own for each input of each step, beside x_0 and p."""
    rng = np.random.default_rng(1)
    n_x, n_p, n, m = 4, 2, 5, 2
    variance, from_output = rng.uniform(0.5, 2.0, n_x), rng.normal(size=(n_x, n_p))
    recursion = SensitivityRecursion(from_output, variance)
    state = np.hstack([np.eye(n_x), np.zeros((n_x, n_p + n * m))])
    from_noise = np.zeros((n_x, n * n_x))
    output = np.hstack([np.zeros((n_x, n_x)), from_output, np.zeros((n_x, n * m))])
    rows, noise = [state + output], [from_noise]
    for k in range(n):
        step, root, effect = (0.5 * rng.normal(size=(n_x, n_x)) for _ in range(3))
        unknown = rng.normal(size=(n_x, m)) * [1.0, 1e3]
        recursion.step(step, root @ root.T, effect[:, :n_p], unknown)
        state, from_noise = step @ state, step @ from_noise
        state[:, n_x : n_x + n_p] += effect[:, :n_p]
        state[:, n_x + n_p + k * m : n_x + n_p + (k + 1) * m] += unknown
        from_noise[:, k * n_x : (k + 1) * n_x] += root
        rows.append(state + output)
        noise.append(from_noise)
    design, spread = np.vstack(rows), np.vstack(noise)
    covariance = spread @ spread.T + np.diag(np.tile(variance, n + 1))
    everything = np.linalg.inv(design.T @ np.linalg.solve(covariance, design))
    expected = everything[n_x : n_x + n_p, n_x : n_x + n_p]
    np.testing.assert_allclose(np.linalg.inv(recursion.information), expected, rtol=1e-8)


def test_inputs_that_do_the_same_count_once() -> None:
    effect, from_output = np.eye(3)[:, :1], np.eye(3)[:, 1:]
    information = []
    for unknown in (effect, np.hstack([effect, 2.0 * effect])):
        recursion = SensitivityRecursion(from_output, np.ones(3))
        recursion.step(np.eye(3), 0.1 * np.eye(3), from_output, unknown)
        information.append(recursion.information)
    np.testing.assert_allclose(information[1], information[0], rtol=1e-12)


def test_the_bound_without_force_sensors_is_what_the_filter_knows(pushed: Pushed) -> None:
    """With a sensor at one foot; the mass of the other one, which never leaves the ground, is not asked for."""
    walk = replace(_first(pushed.walk, 601), open_axes=tuple(range(6)))
    asked = [k for k, name in enumerate(pushed.space.names) if "l_foot" not in name]
    space = ParameterSpace(tuple(replace(pushed.space.parameters[k], tangent=True) for k in asked))
    truth = pushed.truth[asked]
    sensors = NoisySensors(WHITE, open_axes=walk.open_axes)
    bank = sensors.bank(pushed.robot, space, walk.contact_bodies, walk.timestep_s, 1, 1)
    bank.place(truth[None])
    information = np.zeros((len(space), len(space)))
    for _, errors in bank.replay(walk, walk.segments[0]):
        assert errors.tangents is not None
        flat = errors.tangents.reshape(len(space), -1)
        information += walk.timestep_s * flat @ flat.T
    bound = cramer_rao(walk, pushed.robot, space, truth, WHITE)
    expected = np.sqrt(np.diagonal(np.linalg.inv(information)))
    np.testing.assert_allclose(np.sqrt(np.diagonal(bound.covariance)), expected, rtol=0.1)


def test_the_bound_is_what_the_estimator_expects_of_itself(pushed: Pushed) -> None:
    """Two programmes that share no code: derivatives of the plant here, a bank of filters on a noisy log there."""
    walk = _first(pushed.walk, 1201)
    noisy = Sensors(WHITE, len(walk.joint_names), walk.contact_bodies, np.random.default_rng(1)).measure(walk)
    options = IdentifyOptions(noise="white", other_links=0.0, link_inertia=0.0, lag_s=0.0, dwell_s=0.3, passes=3)
    uncertainty = weigh_offline(noisy, pushed.robot, pushed.space, options).uncertainty
    assert uncertainty is not None
    expected = np.sqrt(np.diagonal(uncertainty.covariance) / uncertainty.inflation)
    bound = cramer_rao(walk, pushed.robot, pushed.space, pushed.truth, WHITE, gate=False)
    np.testing.assert_allclose(bound.std, expected, rtol=0.1)


def test_the_bound_is_proportional_to_the_noise(pushed: Pushed) -> None:
    once, twice = (_bound(pushed, noise=WHITE.scaled(factor)) for factor in (1.0, 2.0))
    np.testing.assert_allclose(twice.std, 2.0 * once.std, rtol=1e-6)


def test_more_walking_and_less_doubt_never_hurt(pushed: Pushed) -> None:
    plain = _bound(pushed)
    assert np.all(_bound(pushed, 600).std < plain.std)
    offset = EffortOffset("l_knee", **nuisance(0.4))
    gain = WrenchGain("l_foot", 2, **nuisance(0.01))
    encoder = EncoderOffset("r_knee", **nuisance(2e-3))
    inertia = InertiaScale("torso", **nuisance(0.1))
    lags = [EffortLag(**nuisance(5e-4)), WrenchLag(**nuisance(5e-4))]
    doubtful = _bound(pushed, 300, offset, gain, encoder, inertia, *lags)
    assert np.all(doubtful.std > plain.std)
    certain = [replace(p, prior_std=1e-9) for p in (offset, gain, encoder, inertia, *lags)]
    np.testing.assert_allclose(_bound(pushed, 300, *certain).std, plain.std, rtol=1e-6)
    assert doubtful.problem == "7 mass, 1 effort_offset (other) +-0.4, 1 wrench_gain (other) +-0.01, " + (
        "1 encoder_offset (other) +-0.002, 1 inertia_scale (other) +-0.1, 1 effort_lag (other) +-0.0005, "
        "1 wrench_lag (other) +-0.0005"
    )


def test_a_foot_known_to_be_in_the_air_helps(pushed: Pushed) -> None:
    """Also about its sensor: what reads something there is the offset."""
    wrench = pushed.walk.wrench.copy()
    wrench[100:, 1] = 0.0
    lifted = replace(pushed, walk=replace(pushed.walk, wrench=wrench))
    offset = WrenchOffset("r_foot", 2, **nuisance(4.0))
    gated, open_ = (_bound(lifted, 300, offset, gate=gate) for gate in (True, False))
    assert np.all(gated.std < open_.std)
    assert np.sqrt(gated.covariance[-1, -1]) < 2.0 / np.sqrt(200 - 1)  # N: 200 readings of 2 N noise


def test_a_robot_that_integrates_with_runge_kutta_is_bounded_as_with_euler(pushed: Pushed) -> None:
    stages = replace(pushed, robot=make_robot("RK4"))
    np.testing.assert_allclose(_bound(stages).std, _bound(pushed).std, rtol=1e-9)


def test_what_has_no_bound_is_refused(pushed: Pushed) -> None:
    with pytest.raises(BadInputError, match="Without noise on every measured state there is nothing to bound"):
        _bound(pushed, noise=SensorNoise(effort=1.0))
    strange = Parameter("x", **nuisance(1.0))
    with pytest.raises(BadInputError, match="no bound for x: only for bodies and for slow errors"):
        _bound(pushed, 10, strange)
    with pytest.raises(BadInputError, match="do not bound every unknown: name fewer links"):
        _bound(pushed, 1)
