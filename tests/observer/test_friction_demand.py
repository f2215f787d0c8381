"""What holds a joint, and what noise makes of it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.observer.friction_demand import Demand, FrictionSolver
from massid.observer.replay import ReplayBlock, replay_block
from massid.walk import Segment
from massid.walk.noise import PRESETS, Sensors
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about

LOSS_NM = 3.0
WHITE = PRESETS["white"]


def _rubbing(joints: tuple[str, ...] | None) -> Robot:
    """The biped with dry friction in all joints or in some."""
    if joints is None:
        return make_robot(friction_loss=LOSS_NM)
    spec = make_robot().spec.copy()
    for name in joints:
        spec.joint(name).frictionloss = LOSS_NM
    return Robot(spec)


def _model(robot: Robot) -> mujoco.MjModel:
    """With the masses that the robot has in truth."""
    space = mass_space(robot, LINKS)
    model = robot.identification_model(FEET)
    write_fields(model, robot.realise(space, draw_truth(space, seed=4)))
    return model


def _solve(robot: Robot, model: mujoco.MjModel, block: ReplayBlock) -> Demand:
    solver = FrictionSolver(model, robot.layout, WHITE)
    return solver.solve(block.qpos[:-1], block.qvel[:-1], block.effort, block.wrench, averaged=1)


@pytest.mark.parametrize("joint", ["l_knee", "r_hip_roll"])
def test_what_a_joint_needs_is_what_friction_without_a_limit_would_exert(joint: str) -> None:
    """Also while it slides; other joints have no friction that would answer."""
    robot = _rubbing((joint,))
    space = mass_space(robot, LINKS)
    walk = push_about(robot, space, draw_truth(space, seed=4), seconds=0.6, amplitude=0.15)
    block, column = replay_block(walk, robot.layout, Segment(0, len(walk))), robot.joint_names.index(joint)
    model = _model(robot)
    needed = _solve(robot, model, block).needed[:, column]
    model.dof_frictionloss[model.dof_frictionloss > 0.0] = 1e9
    np.testing.assert_allclose(needed, _solve(robot, model, block).torque[:, column], rtol=1e-2, atol=1e-6)
    assert 0.1 < np.mean(np.abs(needed) > LOSS_NM) < 0.9


def test_it_needs_the_torque_that_acts_as_long_as_that_has_reserve() -> None:
    robot = _rubbing(None)
    space = mass_space(robot, LINKS)
    walk = push_about(robot, space, draw_truth(space, seed=4), seconds=0.6, amplitude=0.15)
    found = _solve(robot, _model(robot), replay_block(walk, robot.layout, Segment(0, len(walk))))
    sticks = np.abs(found.torque) < LOSS_NM * (1.0 - 1e-9)
    assert 0.1 < sticks.mean() < 0.9
    np.testing.assert_array_equal(found.needed[sticks], found.torque[sticks])
    assert np.all(np.abs(found.needed[~sticks]) >= LOSS_NM * (1.0 - 1e-9))


def test_its_deviation_is_the_scatter_that_sensors_make() -> None:
    """Of joints that stick, over many readings of the same instant."""
    robot = _rubbing(None)
    space = mass_space(robot, LINKS)
    walk = push_about(robot, space, draw_truth(space, seed=4), seconds=0.1, amplitude=0.02)
    whole, n = Segment(0, len(walk)), 40
    model = _model(robot)
    truth = _solve(robot, model, replay_block(walk, robot.layout, whole))
    noise = np.random.default_rng(0)
    measured = [Sensors(WHITE, 8, FEET, noise).measure(walk) for _ in range(n)]
    found = [_solve(robot, model, replay_block(one, robot.layout, whole)).torque for one in measured]
    sticks = np.abs(truth.torque).max(axis=0) < 0.5 * LOSS_NM
    assert sticks.sum() >= 4
    scatter = np.sqrt(np.mean((np.array(found) - truth.torque) ** 2, axis=(0, 1)))
    np.testing.assert_allclose(scatter[sticks], np.sqrt((truth.std**2).mean(axis=0))[sticks], rtol=0.15)


def test_a_joint_without_friction_needs_nothing_of_it() -> None:
    robot = _rubbing(("l_knee",))
    space = mass_space(robot, LINKS)
    walk = push_about(robot, space, space.nominal, seconds=0.05)
    found = _solve(robot, robot.identification_model(FEET), replay_block(walk, robot.layout, Segment(0, len(walk))))
    others = np.arange(8) != robot.joint_names.index("l_knee")
    for values in (found.torque, found.needed, found.std):
        assert not values[:, others].any()
        assert values[:, ~others].any()
