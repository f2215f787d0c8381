"""The paper's systems: integration against scipy, zero response, blocks, the Bank protocol, divergence."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from massid.errors import BadInputError
from massid.search.bank import Bank
from massid.search.guided import GuidedSearch
from massid.search.online import score_block
from massid.search.proposal import Proposal, Role
from massid.systems import affine, non_affine
from massid.systems.bank import SystemBank
from massid.systems.online import run_online
from massid.systems.plant import Controller, Disturbance, Plant
from massid.systems.system import MeasuredBlock, System
from massid.typing import FloatArray

STEP_S = 1e-3


def _affine_slope(t: float, x: FloatArray, u: float) -> list[float]:
    p = affine.TRUTH
    forced = p[0] * math.sin(x[0] + x[1]) + p[1] * math.exp(x[0] + u) + p[2] * (x[0] ** 2 + x[1])
    return [x[1], -affine.STIFFNESS * x[0] - affine.DAMPING * x[1] + u + forced]


def _non_affine_slope(t: float, x: FloatArray, u: float) -> list[float]:
    p = non_affine.TRUTH
    return [x[1], u + p[0] * (x[0] + math.sin(x[0])) + 14.0 * math.sin(p[1] * x[1]) + math.exp(p[2] * x[0])]


@pytest.mark.parametrize("name", ["affine", "non-affine"])
def test_the_plant_agrees_with_solve_ivp(name: str) -> None:
    """The same inputs, held over each step, through an integrator with error control."""
    if name == "affine":
        plant, slope = affine.affine_plant(affine.affine_system()), _affine_slope
    else:
        system = non_affine.non_affine_system()
        plant, slope = non_affine.non_affine_plant(system, np.random.default_rng(0), noise=0.0), _non_affine_slope
    motion = plant.run(0.5, plant.system.space.nominal)
    state = np.zeros(2)
    for k, (u,) in enumerate(motion.block.control):
        np.testing.assert_allclose(state, motion.states[k], rtol=1e-8, atol=1e-9)
        solution = solve_ivp(slope, (0.0, STEP_S), state, args=(u,), rtol=1e-10, atol=1e-12)
        state = solution.y[:, -1]
    np.testing.assert_allclose(state, motion.block.measured[-1], rtol=1e-8, atol=1e-9)


def test_an_identification_model_agrees_with_solve_ivp() -> None:
    """Eq. (20) integrated together with the plant of Eq. (19): the model sees the plant's state, not samples of it."""
    system = non_affine.non_affine_system()
    motion = non_affine.non_affine_plant(system, np.random.default_rng(0), noise=0.0).run(0.3, non_affine.START)
    wrong = np.array([8.0, 1.0, 2.0])
    bank = SystemBank(system, 1, STEP_S)
    bank.place(wrong[None])
    bank.restart(motion.block)
    errors = bank.advance(motion.block).values[0]

    def joint(t: float, z: FloatArray, u: float) -> list[float]:
        x1, x2 = z[:2]
        model = u + wrong[0] * (x1 + math.sin(x1)) + 14.0 * math.sin(wrong[1] * x2) + math.exp(wrong[2] * x1)
        gain = non_affine.GAIN
        return [*_non_affine_slope(t, z[:2], u), x2 + gain * (x1 - z[2]), model + gain * (x2 - z[3])]

    state = np.zeros(4)
    for k, (u,) in enumerate(motion.block.control):
        state = solve_ivp(joint, (0.0, STEP_S), state, args=(u,), rtol=1e-10, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(errors[k], state[2:] - state[:2], atol=1e-8)
    assert np.abs(errors).max() > 0.05


@pytest.mark.parametrize("gain", [0.5, 50.0])
def test_zero_response_for_correct_parameters(gain: float) -> None:
    """The basic assumption of Section II: with p = p* the error stays where it began, at zero."""
    system = non_affine.non_affine_system(gain=gain)
    block = non_affine.non_affine_plant(system, np.random.default_rng(0), noise=0.0).run(4.0, non_affine.START).block
    points = np.vstack([non_affine.TRUTH, non_affine.TRUTH + 1e-3])
    mu = score_block(SystemBank(system, 2, STEP_S), _proposal(points), block, 0.0).mu
    assert mu[0] < 1e-9 * mu[1]  # what RK4 with full and with half steps differ by


def test_zero_response_with_one_state_measured() -> None:
    """From the true state on; x2 is the model's own afterwards."""
    system = non_affine.output_system()
    plant = non_affine.non_affine_plant(system, np.random.default_rng(0), noise=0.0)
    motion = plant.run(2.0, non_affine.TRUTH)
    points = np.vstack([non_affine.TRUTH, non_affine.TRUTH + 1e-2])
    mu = score_block(SystemBank(system, 2, STEP_S), _proposal(points), motion.block, 0.0).mu
    assert mu[0] < 1e-6 * mu[1]
    assert motion.block.measured.shape[1] == 1


def test_models_do_not_touch_each_other() -> None:
    system = affine.affine_system()
    block = affine.affine_plant(system).run(0.5, affine.START).block
    points = np.random.default_rng(0).uniform(-10.0, 10.0, size=(7, 3))
    bank, alone = SystemBank(system, 7, STEP_S), SystemBank(system, 1, STEP_S)
    bank.place(points)
    bank.restart(block)
    together = bank.advance(block).values
    for point, expected in zip(points, together, strict=True):
        alone.place(point[None])
        alone.restart(block)
        np.testing.assert_array_equal(alone.advance(block).values[0], expected)


def test_a_window_may_come_in_parts() -> None:
    system = affine.affine_system()
    block = affine.affine_plant(system).run(0.4, affine.START).block
    bank = SystemBank(system, 1, STEP_S)
    bank.place(affine.START[None])
    bank.restart(block)
    whole = bank.advance(block).values
    bank.restart(block)
    parts = [
        bank.advance(
            MeasuredBlock(block.start, block.measured[2 * k : 2 * k + 201], block.control[k : k + 100], STEP_S)
        )
        for k in range(0, 400, 100)
    ]
    np.testing.assert_array_equal(np.concatenate([part.values for part in parts], axis=1), whole)


def test_diverged_models_are_marked() -> None:
    def explosive(x: FloatArray, p: FloatArray, u: FloatArray, dx: FloatArray) -> None:
        dx[0] = p[0] * x[0] ** 3 + u[0]

    from massid.search.parameters import ParameterSpace
    from massid.systems.system import coefficient

    space = ParameterSpace((coefficient("p", 0.0, -1e6, 1e6),))

    # Nothing but x0 = 1 is known: the models run freely, measured is the other state.
    def two_states(x: FloatArray, p: FloatArray, u: FloatArray, dx: FloatArray) -> None:
        dx[0] = p[0] * x[0] ** 3
        dx[1] = x[0]

    system = System("explosive", two_states, 2, 1, space, np.zeros((2, 1)), measured=(1,))
    block = MeasuredBlock(np.array([1.0, 0.0]), np.zeros((201, 1)), np.zeros((100, 1)), 0.01)
    bank: Bank[MeasuredBlock] = SystemBank(system, 2, 0.01)
    bank.place(np.array([[-1.0], [1e5]]))
    bank.restart(block)
    assert bank.advance(block).diverged.tolist() == [False, True]
    bank.restart(block)
    bank.place(np.array([[-1.0], [-1.0]]))
    assert not bank.advance(block).diverged.any()


def test_noise_is_held_and_seeded() -> None:
    noise = Disturbance(np.array([0.0, 0.1]), hold_s=0.01)
    draws = noise.draw(1000, 0, STEP_S, np.random.default_rng(0))
    assert np.all(draws[:, 0] == 0.0)
    assert np.all(draws[::10, 1] == draws[9::10, 1])
    assert draws[::10, 1].std() == pytest.approx(0.1, rel=0.3)
    np.testing.assert_array_equal(draws, noise.draw(1000, 0, STEP_S, np.random.default_rng(0)))
    with pytest.raises(BadInputError, match="whole number of noise holds"):
        noise.draw(1005, 0, STEP_S, np.random.default_rng(0))


def test_the_controller_tracks_and_better_with_the_true_parameters() -> None:
    system = non_affine.non_affine_system()
    worst = []
    for estimate in (non_affine.START, non_affine.TRUTH):
        plant = non_affine.non_affine_plant(system, np.random.default_rng(0))
        plant.run(4.0, estimate)
        motion = plant.run(4.0, estimate)
        worst.append(np.abs(motion.states[:, 0] - non_affine.desired(motion.times_s)).max())
    assert worst[1] < 2e-3
    assert 0.02 < worst[0] < 0.5


def test_a_plant_that_is_not_held_is_an_error() -> None:
    system = non_affine.non_affine_system()

    def push(time: float, x: FloatArray, p: FloatArray, settings: FloatArray, u: FloatArray) -> None:
        u[0] = 1e4

    plant = Plant(system, non_affine.TRUTH, Controller(push), np.zeros(2))
    with pytest.raises(BadInputError, match=r"V-B left the finite numbers"):
        plant.run(4.0, non_affine.START)


def test_bad_systems_are_refused() -> None:
    space = affine.affine_space()
    with pytest.raises(BadInputError, match=r"gain has shape \(3, 3\); 2 states and 2 measured ones need \(2, 2\)"):
        System("s", affine.affine_rate, 2, 1, space, np.eye(3))
    with pytest.raises(BadInputError, match=r"measured states \(2,\) must lie in 0 .. 1"):
        System("s", affine.affine_rate, 2, 1, space, np.zeros((2, 1)), measured=(2,))
    with pytest.raises(BadInputError, match="give observer_gain"):
        Plant(non_affine.output_system(), non_affine.TRUTH, non_affine.Tracking().controller(), np.zeros(2))
    bank = SystemBank(affine.affine_system(), 2, STEP_S)
    with pytest.raises(BadInputError, match=r"shape \(3, 3\) for a bank that holds \(2, 3\)"):
        bank.place(np.zeros((3, 3)))
    with pytest.raises(BadInputError, match=r"steps of 0\.01 s for a bank with 0\.001 s"):
        bank.advance(MeasuredBlock(np.zeros(2), np.zeros((3, 2)), np.zeros((1, 1)), 0.01))


def test_same_seed_same_run() -> None:
    def run() -> FloatArray:
        system = non_affine.non_affine_system()
        plant = non_affine.non_affine_plant(system, np.random.default_rng(4))
        search = GuidedSearch(system.space, 9, rng=np.random.default_rng(5))
        return run_online(plant, SystemBank(system, 9, STEP_S), search, 3, 1.0, 0.1).estimates

    np.testing.assert_array_equal(run(), run())


def test_copies_are_independent() -> None:
    """Two copies side by side score what each scores alone."""
    system = non_affine.copied_system(2)
    plant = Plant(system, np.tile(non_affine.TRUTH, 2), non_affine.copied_controller(2), np.zeros(4), STEP_S)
    block = plant.run(1.0, system.space.nominal).block
    first, second = non_affine.START, np.array([10.0, 1.9, 1.2])
    truth = non_affine.TRUTH
    points = np.array([[*first, *truth], [*truth, *second], [*first, *second]])
    mu = score_block(SystemBank(system, 3, STEP_S), _proposal(points), block, 0.0).mu
    assert mu[0] + mu[1] == pytest.approx(mu[2], rel=1e-9)


def _proposal(points: FloatArray) -> Proposal:
    return Proposal(points, (Role.CENTRE, *[Role.SAMPLE] * (len(points) - 1)))
