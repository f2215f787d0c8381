from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from numpy.testing import assert_allclose

from massid.view.motion import sample_motion
from tests.conftest import Pushed


def test_frames_come_at_fifty_hertz_and_hold_the_engines_poses(pushed: Pushed) -> None:
    motion = sample_motion(pushed.walk, pushed.robot)
    assert_allclose(np.diff(motion.time_s), 0.02, atol=1e-9)
    k = len(motion) // 2
    aligned = pushed.robot.align(pushed.walk)
    data = mujoco.MjData(pushed.robot.model)
    data.qpos[:] = pushed.robot.layout.to_qpos(aligned.qpos[20 * k])
    mujoco.mj_kinematics(pushed.robot.model, data)
    assert_allclose(motion.position[k], data.xpos, atol=1e-12)
    assert_allclose(motion.quaternion[k][:, [3, 0, 1, 2]], data.xquat, atol=1e-12)


def test_vertical_forces_carry_the_robot(pushed: Pushed) -> None:
    motion = sample_motion(pushed.walk, pushed.robot)
    masses = dict(zip(pushed.space.names, pushed.truth.tolist(), strict=True))
    weight_n = 9.81 * sum(masses.values())
    # it wriggles on its feet and does not leave the ground, so the mean force is the weight but for its acceleration
    assert_allclose(motion.vertical_force.sum(axis=1).mean(), weight_n, rtol=0.1)


def test_the_pressure_point_explains_the_measured_moment(pushed: Pushed) -> None:
    foot = pushed.robot.model.body("l_foot")
    sole = np.array([0.1, -0.03, -0.07])  # the sole of this robot lies 7 cm below its ankle
    force, twist = np.array([20.0, -10.0, 300.0]), np.array([0.0, 0.0, 2.0])
    wrench = pushed.walk.wrench.copy()
    wrench[:, 0] = np.concatenate([force, np.cross(sole, force) + twist])
    wrench[:, 1] = 0.0
    motion = sample_motion(replace(pushed.walk, wrench=wrench), pushed.robot)
    assert motion.contact_bodies[0] == foot.name
    assert_allclose(motion.pressure_point[:, 0], np.tile(sole, (len(motion), 1)), atol=1e-9)
    assert_allclose(motion.pressure_point[:, 1], np.tile([0.04, 0.0, -0.07], (len(motion), 1)), atol=1e-9)  # its middle


def test_a_pressure_point_never_leaves_the_foot(pushed: Pushed) -> None:
    wrench = np.zeros_like(pushed.walk.wrench)
    wrench[:, :, 2], wrench[:, :, 3:5] = 100.0, 1e4
    motion = sample_motion(replace(pushed.walk, wrench=wrench), pushed.robot)
    assert np.all(np.abs(motion.pressure_point[..., 0] - 0.04) <= 0.2 + 1e-9)
    assert np.all(np.abs(motion.pressure_point[..., 1]) <= 0.08 + 1e-9)
