"""Friction loss and damping of joints, against a plant whose joints were written by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from massid.errors import BadInputError, ModelError
from massid.identify import IdentifyOptions, Status, identify_offline
from massid.log.walk import Walk
from massid.noise import PRESETS, Sensors
from massid.robot import Robot
from massid.search.guided import enough_models
from massid.typing import FloatArray
from massid.unknowns import mass_space, parameter_space
from tests.pushed_robot import LINKS, draw_truth, make_robot, push_about

FRICTION_NM, DAMPING = 1.5, 0.8
NOMINAL = make_robot(friction_loss=0.5)


@pytest.fixture(scope="module")
def log() -> tuple[Walk, FloatArray]:
    """A walk with another friction in one knee and another damping in both hips, and the true masses."""
    spec = NOMINAL.spec.copy()
    spec.joint("l_knee").frictionloss = FRICTION_NM
    for side in ("l", "r"):
        spec.joint(f"{side}_hip_pitch").damping = np.array([DAMPING, 0.0, 0.0])[: len(spec.joint("l_knee").damping)]
    true = Robot(spec)
    masses = mass_space(true, LINKS)
    truth = draw_truth(masses, seed=3)
    return push_about(true, masses, truth, seconds=0.8), truth


def test_friction_and_damping_are_found_beside_the_masses(log: tuple[Walk, FloatArray]) -> None:
    walk, masses_kg = log
    space = parameter_space(NOMINAL, LINKS, friction=["l_knee"], damping=["l_hip_pitch", "r_hip_pitch"])
    options = IdentifyOptions(dwell_s=0.2, noise="clean", bank_size=enough_models(len(space)))
    result = identify_offline(walk, NOMINAL, space, options)
    expected = [*masses_kg, FRICTION_NM, DAMPING, DAMPING]
    np.testing.assert_allclose(result.estimate, expected, atol=1e-6)  # kg, N m, N m s/rad
    assert result.status is Status.CONVERGED
    assert [quantity.unit for quantity in result.quantities] == ["N m", "N m s/rad", "N m s/rad"]


def test_the_saved_model_has_the_joints_that_were_found(tmp_path: Path) -> None:
    space = parameter_space(NOMINAL, ["torso"], friction=["l_knee"], damping=["r_ankle"])
    NOMINAL.write_mjcf(space, np.array([20.0, FRICTION_NM, DAMPING]), tmp_path / "saved.xml")
    saved = Robot.load(tmp_path / "saved.xml").model
    assert saved.joint("l_knee").frictionloss == pytest.approx(FRICTION_NM)
    assert saved.joint("r_knee").frictionloss == pytest.approx(0.5)
    assert saved.joint("r_ankle").damping == pytest.approx(DAMPING)


def test_friction_in_a_noisy_log_is_refused(log: tuple[Walk, FloatArray]) -> None:
    walk, _ = log
    measured = Sensors(PRESETS["white"], 8, walk.contact_bodies, np.random.default_rng(0)).measure(walk)
    space = parameter_space(NOMINAL, LINKS, friction=["l_knee"])
    with pytest.raises(BadInputError, match="leave out friction/l_knee"):
        identify_offline(measured, NOMINAL, space, IdentifyOptions(noise="white"))


def test_a_joint_that_does_not_exist_is_named() -> None:
    with pytest.raises(ModelError, match=r"no joint named 'l_nee'\. Did you mean"):
        parameter_space(NOMINAL, LINKS, damping=["l_nee"])
