"""Dry friction that the model file lacks is told from the log; a model that has it is not doubted."""

from __future__ import annotations

import numpy as np
import pytest

from massid.audit import audit_walk
from massid.walk.noise import PRESETS, NoisePreset, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import make_robot, push_about

LOSS = 1.5


@pytest.mark.parametrize("noise", ["clean", "realistic"])
def test_friction_that_the_model_lacks_is_named_joint_by_joint(pushed: Pushed, noise: NoisePreset) -> None:
    robot = make_robot(friction_loss=LOSS)
    walk = push_about(robot, pushed.space, pushed.truth, seconds=1.6, amplitude=0.25)
    if noise != "clean":
        rng = np.random.default_rng(1)
        walk = Sensors(PRESETS[noise], len(robot.joint_names), walk.contact_bodies, rng).measure(walk)
    lines = [line for line in audit_walk(pushed.robot, walk).warnings if "dry friction" in line]
    assert len(lines) == 1
    assert sum(joint in lines[0] for joint in robot.joint_names) >= 2
    assert "(`friction`)" in lines[0]
    assert not any("dry friction" in line for line in audit_walk(robot, walk).warnings)  # this model has it
