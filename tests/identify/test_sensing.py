"""What a log says about its sensors before anything is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from massid.identify import IdentifyOptions
from massid.identify.sensing import estimate_white_noise, nuisances
from massid.model.robot import Robot
from massid.model.unknowns.joints import Armature
from massid.model.unknowns.sensors import WrenchOffset
from massid.typing import FloatArray
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import FEET

WHITE = PRESETS["white"]
OPTIONS = IdentifyOptions(other_links=0.0, link_inertia=0.0, lag_s=0.0)


def _one_foot_lifted(pushed: Pushed, offset: FloatArray, seed: int) -> Walk:
    """A noisy log whose left foot is in the air for a quarter of the time."""
    wrench = pushed.walk.wrench.copy()
    wrench[600:1000, 0] = 0.0
    walk = replace(pushed.walk, wrench=wrench)
    walk = Sensors(WHITE, 8, FEET, np.random.default_rng(seed)).measure(walk)
    shifted = walk.wrench.copy()
    shifted[:, :, :3] += offset
    return replace(walk, wrench=shifted)


def test_force_offsets_are_read_off_feet_in_the_air(pushed: Pushed) -> None:
    noise, errors = PRESETS["realistic"], []
    for seed in range(25):
        offset = noise.force_offset * np.random.default_rng(100 + seed).uniform(-1.5, 1.5, (2, 3))
        walk = _one_foot_lifted(pushed, offset, seed)
        unknown = nuisances(pushed.robot, walk, pushed.space, noise, OPTIONS)
        found = {p.target: p for p in unknown if isinstance(p, WrenchOffset)}
        assert len(found) == 6
        for axis in range(3):
            left, right = found[f"l_foot/{axis}"], found[f"r_foot/{axis}"]
            assert (right.nominal, right.prior_std) == (0.0, noise.force_offset)  # always loaded: nothing to be read
            assert left.prior_std is not None
            assert 1.0 < left.prior_std / (noise.force / np.sqrt(400)) < 1.1
            errors.append((left.nominal - offset[0, axis]) / left.prior_std)
    assert np.abs(errors).max() < 4.0
    assert 0.5 < np.mean(np.square(errors)) < 1.5  # 75 degrees of freedom: 1 +- 0.16


def test_force_sensors_that_read_plain_zero_have_no_offset(pushed: Pushed) -> None:
    walk = Sensors(WHITE, 8, FEET, np.random.default_rng(0)).measure(pushed.walk)
    walk = replace(walk, wrench=np.zeros_like(walk.wrench))
    found = nuisances(pushed.robot, walk, pushed.space, estimate_white_noise(walk), OPTIONS)
    offsets = [p for p in found if isinstance(p, WrenchOffset)]
    assert len(offsets) == 6
    assert all(p.nominal == 0.0 and p.prior_std is not None and p.prior_std < 0.01 for p in offsets)


def test_rotors_are_unknown_where_the_model_file_has_none(pushed: Pushed) -> None:
    def armatures(robot: Robot) -> list[str]:
        found = nuisances(robot, pushed.walk, pushed.space, WHITE, OPTIONS)
        return [one.target for one in found if isinstance(one, Armature)]

    bare, geared = pushed.robot.spec.copy(), pushed.robot.spec.copy()
    for joint in bare.joints:
        joint.armature = 0.0
    geared.joint("l_knee").armature = 0.01
    assert armatures(Robot(bare)) == list(pushed.robot.joint_names)
    assert armatures(Robot(geared)) == []
