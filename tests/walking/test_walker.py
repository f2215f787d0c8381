from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.errors import ModelError
from massid.typing import FloatArray
from massid.walking import GAITS, Gait, Phase, Walker, WalkerOptions, qp
from massid.walking.stepper import StepperOptions
from tests.walking.floor import SEVEN_LINKS, Plant, error_factors, nominal, on_floor

STILL = {"arm_rad": 0.0, "torso_rad": 0.0, "height_m": 0.0}


def walker(name: str, gait: Gait, seed: int = 0) -> Walker:
    return Walker(nominal(name), gait, np.random.default_rng(seed))


@pytest.mark.parametrize("gait", [name for name in GAITS if name != "stand"])
def test_atlas_walks_with_masses_it_does_not_know(gait: str) -> None:
    factors = error_factors(nominal("atlas"), 6.0, np.random.default_rng(5))
    plant = Plant(on_floor("atlas", factors), walker("atlas", GAITS[gait], seed=5))
    assert plant.run(6.0)
    assert plant.walker.steps_taken >= 5
    assert plant.walker.failed_solves == 0


@pytest.mark.parametrize("name", ["light", "heavy"])
def test_other_bodies_walk_by_their_parameters_alone(name: str) -> None:
    model = nominal(name)
    norm = float(np.linalg.norm([model.body(link).mass[0] for link in SEVEN_LINKS]))
    factors = error_factors(model, norm / 4, np.random.default_rng(1))
    plant = Plant(on_floor(name, factors), walker(name, GAITS["random"], seed=1))
    assert plant.run(6.0)
    assert plant.walker.steps_taken >= 5


def test_atlas_walks_with_every_mass_wrong_by_a_fifth() -> None:
    model, rng = nominal("atlas"), np.random.default_rng(2)
    factors = {model.body(i).name: float(rng.uniform(0.8, 1.2)) for i in range(1, model.nbody)}
    plant = Plant(on_floor("atlas", factors), walker("atlas", GAITS["random"], seed=2))
    assert plant.run(7.0)


def test_standing_feet_neither_slide_nor_leave_the_floor_and_the_robot_advances() -> None:
    gait = replace(GAITS["straight"], **STILL)
    plant = Plant(on_floor("atlas"), walker("atlas", gait))
    feet = [plant.model.body(name).id for name in plant.walker.foot_names]
    stood: FloatArray | None = None
    farthest_m = 0.0
    while plant.data.time < 6.0:
        plant.step()
        landed = plant.data.time > 0.1  # it is set down with its soles on the floor but without weight on them
        assert not landed or plant.foot_load_n.sum() > 0.3 * plant.walker.morphology.total_mass_kg * 9.81
        if plant.walker.phase is not Phase.SINGLE:
            stood = None
            continue
        here = plant.data.xpos[feet[int(np.argmax(plant.foot_load_n))]].copy()
        stood = here if stood is None else stood
        farthest_m = max(farthest_m, float(np.linalg.norm(here - stood)))
    assert farthest_m < 0.01  # MuJoCo's friction creeps by some millimetres
    assert_allclose(plant.data.qpos[0], (plant.walker.steps_taken - 1) * gait.forward_m, atol=0.25)
    assert abs(plant.data.qpos[1]) < 0.1


def test_a_robot_without_torques_falls_and_is_seen_to() -> None:
    plant = Plant(on_floor("atlas"), walker("atlas", GAITS["stand"]))
    assert not plant.walker.has_fallen(plant.walker.initial_qpos())
    while plant.data.time < 3.0 and not plant.walker.has_fallen(plant.data.qpos):
        mujoco.mj_step(plant.model, plant.data)
    assert plant.data.time < 3.0


@pytest.mark.parametrize("broken", [np.nan, np.inf])
def test_a_state_that_is_no_number_counts_as_a_fall(broken: float) -> None:
    robot = walker("light", GAITS["stand"])
    qpos = robot.initial_qpos()
    qpos[4] = broken
    assert robot.has_fallen(qpos)


def test_the_same_seed_gives_the_same_walk() -> None:
    def torques(seed: int) -> FloatArray:
        plant = Plant(on_floor("light"), walker("light", GAITS["random"], seed))
        plant.run(1.6)
        return plant.data.qpos.copy()

    assert_allclose(torques(3), torques(3), rtol=0, atol=0)
    assert np.abs(torques(3) - torques(4)).max() > 1e-3


def test_a_gait_with_an_end_comes_to_a_stand() -> None:
    plant = Plant(on_floor("atlas"), walker("atlas", replace(GAITS["straight"], steps=2, **STILL)))
    assert plant.run(5.5)
    assert plant.walker.steps_taken == 2
    assert plant.walker.phase is Phase.STAND
    assert np.abs(plant.data.qvel).max() < 0.1
    assert plant.foot_load_n.min() > 0.3 * plant.foot_load_n.max()


def test_better_masses_are_taken_while_walking() -> None:
    factors = dict.fromkeys(("torso",), 1.15)
    truth = on_floor("atlas", factors)
    plant = Plant(truth, walker("atlas", replace(GAITS["stand"], **STILL)))
    plant.run(2.5)
    sunk_m = plant.walker.initial_qpos()[2] - plant.data.qpos[2]
    better = nominal("atlas")
    better.body_mass[:], better.body_inertia[:] = truth.body_mass, truth.body_inertia
    mujoco.mj_setConst(better, mujoco.MjData(better))
    plant.walker.update_model(better)
    assert plant.run(5.0)
    assert sunk_m > 0.002  # the unknown weight presses it down
    assert plant.walker.initial_qpos()[2] - plant.data.qpos[2] < sunk_m / 2


def test_another_robot_is_refused() -> None:
    with pytest.raises(ModelError, match="joints differ from the first's"):
        walker("atlas", GAITS["stand"]).update_model(nominal("light"))


def test_torques_are_held_between_controls_and_cannot_be_written() -> None:
    robot = walker("atlas", GAITS["stand"])
    qpos, qvel, load = robot.initial_qpos(), np.zeros(34), np.full(2, 770.0)
    first = robot.control(0.0, qpos, qvel, load)
    assert robot.control(0.001, qpos, qvel, load) is first
    assert robot.control(0.002, qpos, qvel, load) is not first
    with pytest.raises(ValueError, match="read-only"):
        first[0] = 1.0


def test_without_a_solution_the_last_torques_are_held(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = walker("atlas", GAITS["stand"])
    qpos, qvel, load = robot.initial_qpos(), np.zeros(34), np.full(2, 770.0)
    first = robot.control(0.0, qpos, qvel, load)
    monkeypatch.setattr(qp, "minimise", lambda *_: None)
    assert robot.control(0.002, qpos, qvel, load) is first
    assert robot.failed_solves == 1


def test_options_reach_their_parts() -> None:
    options = WalkerOptions(control_period_s=0.001, stepper=StepperOptions(adjust_m=0.0))
    robot = Walker(nominal("light"), GAITS["random"], np.random.default_rng(0), options)
    assert Plant(on_floor("light"), robot).run(2.5)
