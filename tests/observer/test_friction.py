from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest
from scipy.ndimage import minimum_filter1d

from massid.log.walk import Segment
from massid.noise import PRESETS, Sensors
from massid.observer.friction import STICKING_S, Friction, StickSlip
from massid.observer.replay import ReplayBlock, replay_block
from massid.observer.spans import Spans
from massid.realisation import write_fields
from massid.robot import Robot
from massid.typing import FloatArray
from massid.unknowns import mass_space
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about

LOSS_NM = 1.0
WHITE = PRESETS["white"]
WIDTH = Spans.at(1e-3).width


@dataclass(frozen=True)
class Rubbing:
    """A log of the biped with dry friction in its joints, what is measured of it and what its friction was.

    Attributes:
        block: without noise.
        measured: with white noise.
        friction: what the engine's own friction was, shape (n, n_joints) [N m].
    """

    robot: Robot
    stick_slip: StickSlip
    block: ReplayBlock
    measured: ReplayBlock
    friction: FloatArray


@pytest.fixture(scope="module")
def rubbing() -> Rubbing:
    robot = make_robot(friction_loss=LOSS_NM)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=4)
    walk = push_about(robot, space, truth, seconds=1.0, amplitude=0.15)
    noisy = Sensors(WHITE, 8, FEET, np.random.default_rng(0)).measure(walk)
    whole = Segment(0, len(walk))
    block, measured = (replay_block(one, robot.layout, whole) for one in (walk, noisy))
    model = robot.identification_model(FEET)
    stick_slip = StickSlip(model, robot.layout, WHITE)
    realisation = robot.realise(space, truth)
    stick_slip.place(realisation)
    write_fields(model, realisation)
    return Rubbing(robot, stick_slip, block, measured, _friction(model, block)[:, robot.layout.joint_dof])


def _friction(model: mujoco.MjModel, block: ReplayBlock) -> FloatArray:
    """Friction of a motion without noise, sample by sample; no other constraint is active, shape (n, nv) [N m]."""
    data, out = mujoco.MjData(model), np.zeros_like(block.effort)
    for k in range(len(block)):
        data.qpos[:], data.qvel[:] = block.qpos[k], block.qvel[k]
        data.qfrc_applied[:], data.ctrl[:] = block.effort[k], block.wrench[k]
        mujoco.mj_forward(model, data)
        out[k] = data.qfrc_constraint
    return out


def _judge(rubbing: Rubbing, block: ReplayBlock) -> Friction:
    return rubbing.stick_slip.friction(block.qpos[:-1], block.qvel[:-1], block.effort, block.wrench)


def test_where_friction_is_certain_it_is_the_engines_own(rubbing: Rubbing) -> None:
    judged = _judge(rubbing, rubbing.measured)
    torque, certain = judged.torque, judged.sticking == 0.0
    assert 0.2 < certain.mean() < 0.9  # some joints slide, and every joint turns round now and then
    np.testing.assert_allclose(np.abs(torque[certain]), LOSS_NM, rtol=1e-3)
    # A joint that turns round and back within one average goes unnoticed.
    assert np.mean(np.abs(torque - rubbing.friction)[certain] < 1e-2 * LOSS_NM) > 0.99
    np.testing.assert_allclose(judged.sliding * LOSS_NM, np.where(certain, torque, 0.0), atol=1e-3 * LOSS_NM)


def test_a_joint_that_sticks_for_as_long_as_an_average_is_never_certain(rubbing: Rubbing) -> None:
    uncertain = _judge(rubbing, rubbing.measured).sticking
    sticks = minimum_filter1d((np.abs(rubbing.friction) < 0.99 * LOSS_NM).astype(int), WIDTH, axis=0) > 0
    assert sticks.any(axis=0).sum() >= 4
    assert uncertain[sticks].all()


@pytest.mark.parametrize("effort_nm", [0.0, 20.0])
def test_a_robot_at_rest_may_stick_in_every_joint(effort_nm: float, rubbing: Rubbing) -> None:
    """Whatever the measured forces would make its joints do next."""
    rng = np.random.default_rng(1)
    n = 100
    qpos = np.repeat(rubbing.block.qpos[:1], n, axis=0)
    qvel = np.concatenate([np.zeros((n, 6)), WHITE.joint_velocity * rng.normal(size=(n, 8))], axis=1)
    force = np.concatenate([np.zeros((n, 6)), np.full((n, 8), effort_nm)], axis=1)
    judged = rubbing.stick_slip.friction(qpos, qvel, force, np.zeros((n, 12)))
    assert judged.sticking.all()
    assert not judged.sliding.any()
    assert np.all(np.abs(judged.torque) <= LOSS_NM * (1.0 + 1e-9))


def test_a_moment_of_doubt_spreads_over_the_average_that_it_is_part_of(rubbing: Rubbing) -> None:
    """A joint that stops for one averaging width is uncertain for at least as long before and after."""
    n, dof = 200, rubbing.robot.layout.joint_dof
    qpos = np.repeat(rubbing.block.qpos[:1], n, axis=0)
    qvel = np.zeros((n, 14))
    qvel[:, dof] = 2.0
    moving = rubbing.stick_slip.friction(qpos, qvel, np.zeros((n, 14)), np.zeros((n, 12))).sticking
    np.testing.assert_array_equal(moving, 0.0)
    qvel[100, dof] = -28.0  # the average of one width becomes zero
    judged = rubbing.stick_slip.friction(qpos, qvel, np.zeros((n, 14)), np.zeros((n, 12)))
    np.testing.assert_array_equal(np.flatnonzero(judged.sticking[:, 0]), np.arange(101 - WIDTH, 100 + WIDTH))


def test_joints_without_friction_loss_are_certain_to_have_none() -> None:
    robot = make_robot()
    spec = robot.spec.copy()
    spec.joint("l_knee").frictionloss = LOSS_NM
    robot = Robot(spec)
    knee = robot.joint_names.index("l_knee")
    stick_slip = StickSlip(robot.identification_model(FEET), robot.layout, WHITE)
    n = 50
    qpos = np.repeat(robot.layout.to_qpos(np.array([0, 0, 0.92, 1, 0, 0, 0, *[0.1] * 8]))[None], n, axis=0)
    judged = stick_slip.friction(qpos, np.zeros((n, 14)), np.zeros((n, 14)), np.zeros((n, 12)))
    others = np.arange(8) != knee
    assert not judged.torque[:, others].any()
    assert not judged.sticking[:, others].any()
    assert judged.sticking[:, knee].all()
    np.testing.assert_array_equal(stick_slip.sticking_variance > 0.0, ~others)


def test_sticking_is_as_large_as_the_noise_that_stands_for_it(rubbing: Rubbing) -> None:
    """Impulse of the full loss for the time of one sticking, squared = variance of the impulse of that noise."""
    period_s = 1e-3
    impulse_variance = rubbing.stick_slip.sticking_variance * period_s**2 * (STICKING_S / period_s)
    np.testing.assert_allclose(impulse_variance, (LOSS_NM * STICKING_S) ** 2)
