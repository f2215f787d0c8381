"""Friction loss and damping of joints, against a plant whose joints were written by hand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from massid.identify import IdentifyOptions
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space, parameter_space
from massid.result import Status
from massid.search.guided import enough_models
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from tests.pushed_robot import LINKS, draw_truth, make_robot, push_about
from tests.weighed import verdict_on, weigh_offline

FRICTION_NM, DAMPING = 1.5, 0.8
STIFFNESS = 12.0
UNKNOWN_NM, RUBBING = 0.5, ("l_knee", "r_hip_pitch")
NOMINAL = make_robot(friction_loss=0.5)


@pytest.fixture(scope="module")
def log() -> tuple[Walk, FloatArray]:
    """A walk with another friction in one knee and another damping in both hips, and the true masses."""
    true = _with_joints(NOMINAL, {"l_knee": FRICTION_NM}, ("l_hip_pitch", "r_hip_pitch"))
    masses = mass_space(true, LINKS)
    truth = draw_truth(masses, seed=3)
    return push_about(true, masses, truth, seconds=0.8), truth


@pytest.fixture(scope="module")
def rubbing() -> tuple[Walk, FloatArray]:
    """A walk with friction in two joints and more damping in one, of a robot whose model has none."""
    true = _with_joints(make_robot(), dict.fromkeys(RUBBING, UNKNOWN_NM), ("l_hip_pitch",))
    masses = mass_space(true, LINKS)
    truth = draw_truth(masses, seed=3)
    return push_about(true, masses, truth, seconds=1.2, amplitude=0.12), truth


def _with_joints(robot: Robot, friction_nm: Mapping[str, float], damped: Sequence[str]) -> Robot:
    """The robot with another friction loss of some joints and another damping of others."""
    spec = robot.spec.copy()
    for name, loss_nm in friction_nm.items():
        spec.joint(name).frictionloss = loss_nm
    for name in damped:
        spec.joint(name).damping = np.array([DAMPING, 0.0, 0.0])[: len(spec.joint(name).damping)]
    return Robot(spec)


def test_friction_and_damping_are_found_beside_the_masses(log: tuple[Walk, FloatArray]) -> None:
    walk, masses_kg = log
    space = parameter_space(NOMINAL, LINKS, ["friction/l_knee", "damping/l_hip_pitch", "damping/r_hip_pitch"])
    options = IdentifyOptions(dwell_s=0.2, noise="clean", bank_size=enough_models(len(space)))
    result = weigh_offline(walk, NOMINAL, space, options)
    expected = [*masses_kg, FRICTION_NM, DAMPING, DAMPING]
    np.testing.assert_allclose(result.estimate, expected, atol=1e-6)  # kg, N m, N m s/rad
    assert result.status is Status.CONVERGED
    assert [quantity.unit for quantity in result.quantities] == ["N m", "N m s/rad", "N m s/rad"]


def test_the_saved_model_has_the_joints_that_were_found(tmp_path: Path) -> None:
    space = parameter_space(NOMINAL, ["torso"], ["friction/l_knee", "damping/r_ankle"])
    NOMINAL.write_model(space, np.array([20.0, FRICTION_NM, DAMPING]), tmp_path / "saved.xml")
    saved = Robot.load(tmp_path / "saved.xml").model
    assert saved.joint("l_knee").frictionloss == pytest.approx(FRICTION_NM)
    assert saved.joint("r_knee").frictionloss == pytest.approx(0.5)
    assert saved.joint("r_ankle").damping == pytest.approx(DAMPING)


@pytest.mark.parametrize("seed", range(2))
def test_friction_and_damping_are_found_in_a_noisy_log(seed: int, rubbing: tuple[Walk, FloatArray]) -> None:
    """Half a newton metre that the model does not have in two joints; a third one, asked about, has none."""
    walk, masses_kg = rubbing
    nominal = make_robot()
    measured = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(seed)).measure(walk)
    wanted = [f"friction/{joint}" for joint in (*RUBBING, "l_ankle")]
    space = parameter_space(nominal, LINKS, [*wanted, "damping/l_hip_pitch"])
    options = IdentifyOptions(dwell_s=0.2, noise="white", other_links=0.0, link_inertia=0.0, lag_s=0.0)
    result = weigh_offline(measured, nominal, space, options)
    found = result.uncertainty
    assert found is not None
    error = result.estimate - np.array([*masses_kg, UNKNOWN_NM, UNKNOWN_NM, 0.0, DAMPING])
    assert np.all(np.abs(error) < 4.0 * found.std)
    assert error @ np.linalg.solve(found.covariance, error) < 2.0 * len(space)
    assert np.all(found.std[len(LINKS) :] < 0.1)  # N m, N m s/rad
    assert all(quantity.identifiable for quantity in result.quantities)
    blamed = weigh_offline(measured, nominal, mass_space(nominal, LINKS), options)
    assert np.linalg.norm(blamed.estimate - masses_kg) > 1.5 * np.linalg.norm(error[: len(LINKS)])


def test_the_verdict_foresees_how_well_friction_is_known_in_a_noisy_log(rubbing: tuple[Walk, FloatArray]) -> None:
    walk, _ = rubbing
    measured = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(0)).measure(walk)
    options = IdentifyOptions(noise="white", other_links=0.0)
    still = "l_hip_roll"
    qpos, qvel = measured.qpos.copy(), measured.qvel.copy()
    joint = measured.joint_names.index(still)
    qpos[:, 7 + joint], qvel[:, 6 + joint] = 0.0, 0.0
    nominal = make_robot()
    space = parameter_space(nominal, LINKS, ["friction/l_knee", f"friction/{still}"])
    verdict = verdict_on(replace(measured, qpos=qpos, qvel=qvel), nominal, space, options)
    assert verdict.hidden_others == (f"friction/{still}",)


@pytest.mark.parametrize("noise", ["clean", "white"])
def test_a_spring_is_found_beside_the_masses(noise: str, tmp_path: Path) -> None:
    """Its reference position is the model's: springs that pull elsewhere are another matter."""
    nominal = _with_spring(make_robot(), "r_ankle", 5.0)
    true = _with_spring(make_robot(), "r_ankle", STIFFNESS)
    masses = mass_space(true, LINKS)
    masses_kg = draw_truth(masses, seed=3)
    walk = push_about(true, masses, masses_kg, seconds=0.8)
    walk = Sensors(PRESETS[noise], 8, walk.contact_bodies, np.random.default_rng(0)).measure(walk)
    space = parameter_space(nominal, LINKS, ["stiffness/r_ankle"])
    options = IdentifyOptions(dwell_s=0.2, noise=noise, other_links=0.0, link_inertia=0.0, lag_s=0.0)
    result = weigh_offline(walk, nominal, space, options)
    error = result.estimate - [*masses_kg, STIFFNESS]
    if result.uncertainty is None:
        np.testing.assert_allclose(error, 0.0, atol=1e-6)  # kg, N m/rad
    else:
        assert np.all(np.abs(error) < 4.0 * result.uncertainty.std)
        assert result.uncertainty.std[-1] < 0.5  # N m/rad
    nominal.write_model(space, result.estimate, tmp_path / "saved.xml")
    saved = Robot.load(tmp_path / "saved.xml").model
    assert saved.joint("r_ankle").stiffness == pytest.approx(result.estimate[-1], rel=1e-5)
    assert saved.qpos_spring[saved.joint("r_ankle").qposadr[0]] == pytest.approx(0.2)


def _with_spring(robot: Robot, joint: str, stiffness: float) -> Robot:
    spec = robot.spec.copy()
    spec.joint(joint).stiffness = np.array([stiffness, 0.0, 0.0])
    spec.joint(joint).springref = 0.2 if spec.compiler.degree == 0 else np.degrees(0.2)
    return Robot(spec)
