"""Who sticks and who slides, as far as noisy measurements tell."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from massid.model.realisation import write_fields
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.observer.friction import DOUBT_S, Friction, StickSlip
from massid.observer.replay import ReplayBlock, replay_block
from massid.observer.spans import Spans
from massid.typing import FloatArray
from massid.walk import Segment
from massid.walk.noise import PRESETS, Sensors
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about

STRONG_NM, WEAK_NM = 3.0, 0.02
"""Friction well above what the noise of a brief average makes of it, and well below."""
PERIOD_S = 1e-3
WHITE = PRESETS["white"]
WIDTH = Spans.at(PERIOD_S).width


@dataclass(frozen=True)
class Rubbing:
    """A log of the biped with dry friction in its joints, what is measured of it and what its friction was.

    Attributes:
        loss: of every joint [N m].
        measured: with white noise.
        friction: what the engine's own friction was, shape (n, n_joints) [N m].
    """

    robot: Robot
    loss: float
    stick_slip: StickSlip
    measured: ReplayBlock
    friction: FloatArray

    def judge(self) -> Friction:
        block = self.measured
        return self.stick_slip.friction(block.qpos[:-1], block.qvel[:-1], block.effort, block.wrench)


def _rub(loss: float) -> Rubbing:
    robot = make_robot(friction_loss=loss)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=4)
    walk = push_about(robot, space, truth, seconds=1.0, amplitude=0.15)
    noisy = Sensors(WHITE, 8, FEET, np.random.default_rng(0)).measure(walk)
    whole = Segment(0, len(walk))
    block, measured = (replay_block(one, robot.layout, whole) for one in (walk, noisy))
    model = robot.identification_model(FEET)
    stick_slip = StickSlip(model, robot.layout, WHITE, PERIOD_S)
    realisation = robot.realise(space, truth)
    stick_slip.place(realisation)
    write_fields(model, realisation)
    return Rubbing(robot, loss, stick_slip, measured, _friction(model, block)[:, robot.layout.joint_dof])


def _friction(model: mujoco.MjModel, block: ReplayBlock) -> FloatArray:
    """Friction of a motion without noise, sample by sample; no other constraint is active, shape (n, nv) [N m]."""
    data, out = mujoco.MjData(model), np.zeros_like(block.effort)
    for k in range(len(block)):
        data.qpos[:], data.qvel[:] = block.qpos[k], block.qvel[k]
        data.qfrc_applied[:], data.ctrl[:] = block.effort[k], block.wrench[k]
        mujoco.mj_forward(model, data)
        out[k] = data.qfrc_constraint
    return out


@pytest.fixture(scope="module")
def strong() -> Rubbing:
    return _rub(STRONG_NM)


@pytest.fixture(scope="module")
def weak() -> Rubbing:
    return _rub(WEAK_NM)


def test_strong_friction_is_the_engines_own_where_it_is_certain(strong: Rubbing) -> None:
    judged = strong.judge()
    certain = judged.variance < 1e-4 * STRONG_NM**2 * DOUBT_S / PERIOD_S
    assert certain.mean() > 0.7
    sticks, slides = certain & judged.sticks, certain & ~judged.sticks
    assert min(sticks.mean(), slides.mean()) > 0.1
    assert np.mean(np.abs(strong.friction[sticks]) < STRONG_NM * (1.0 - 1e-6)) > 0.995
    assert np.mean(np.abs(judged.torque - strong.friction)[slides] < 1e-2 * STRONG_NM) > 0.995


def test_what_a_wrong_guess_would_do_counts_as_noise(strong: Rubbing) -> None:
    """Taken for sliding, a joint that sticks has the loss instead of its own friction; that error is in the noise."""
    judged = strong.judge()
    wrong = ~judged.sticks & (np.abs(strong.friction) < STRONG_NM * (1.0 - 1e-6))
    error = (judged.torque - strong.friction)[wrong]
    said = np.sqrt(judged.variance[wrong] * PERIOD_S / DOUBT_S)
    assert wrong.sum() > 20
    assert np.mean(np.abs(error) < 2.0 * said) > 0.9  # what speed tells lasts a tenth as long as this takes it to


def test_a_joint_that_sticks_has_no_torque_besides(strong: Rubbing) -> None:
    judged = strong.judge()
    assert not judged.torque[judged.sticks].any()
    assert not judged.sliding[judged.sticks].any()
    slides = judged.sliding != 0.0
    np.testing.assert_allclose(judged.sliding[slides] * STRONG_NM, judged.torque[slides], rtol=1e-9)


def test_weak_friction_is_known_where_a_joint_surely_moves_and_open_elsewhere(weak: Rubbing) -> None:
    judged = weak.judge()
    certain = judged.sliding != 0.0
    assert not judged.sticks.any()
    assert 0.2 < certain.mean() < 0.9  # every joint turns round now and then
    anything = WEAK_NM**2 / 3.0 * WIDTH  # uniform, and another value after each average
    np.testing.assert_allclose(judged.variance, np.where(certain, 0.0, anything), rtol=1e-9)
    # A joint that turns round and back within one average goes unnoticed.
    assert np.mean(np.abs(judged.torque - weak.friction)[certain] < 1e-2 * WEAK_NM) > 0.99
    np.testing.assert_allclose(judged.sliding * WEAK_NM, np.where(certain, judged.torque, 0.0), atol=1e-3 * WEAK_NM)


@pytest.mark.parametrize("effort_nm", [0.0, 20.0])
def test_weak_friction_of_a_robot_at_rest_may_be_anything(effort_nm: float, weak: Rubbing) -> None:
    """Whatever the measured forces would make its joints do next."""
    rng = np.random.default_rng(1)
    n = 100
    qpos = np.repeat(weak.measured.qpos[:1], n, axis=0)
    qvel = np.concatenate([np.zeros((n, 6)), WHITE.joint_velocity * rng.normal(size=(n, 8))], axis=1)
    force = np.concatenate([np.zeros((n, 6)), np.full((n, 8), effort_nm)], axis=1)
    judged = weak.stick_slip.friction(qpos, qvel, force, np.zeros((n, 12)))
    assert judged.variance.all()
    assert not judged.sliding.any()
    assert np.all(np.abs(judged.torque) <= WEAK_NM * (1.0 + 1e-9))


def test_a_moment_of_doubt_spreads_over_the_average_that_it_is_part_of(weak: Rubbing) -> None:
    """A joint that stops for one averaging width is uncertain for at least as long before and after."""
    n, dof = 200, weak.robot.layout.joint_dof
    qpos = np.repeat(weak.measured.qpos[:1], n, axis=0)
    qvel = np.zeros((n, 14))
    qvel[:, dof] = 2.0
    moving = weak.stick_slip.friction(qpos, qvel, np.zeros((n, 14)), np.zeros((n, 12))).variance
    np.testing.assert_array_equal(moving, 0.0)
    qvel[100, dof] = -28.0  # the average of one width becomes zero
    judged = weak.stick_slip.friction(qpos, qvel, np.zeros((n, 14)), np.zeros((n, 12)))
    np.testing.assert_array_equal(np.flatnonzero(judged.variance[:, 0]), np.arange(101 - WIDTH, 100 + WIDTH))


def test_a_joint_under_strong_friction_sticks_until_the_torque_exceeds_it(strong: Rubbing) -> None:
    """At rest, with a torque on one knee that grows through the friction loss."""
    n, knee = 200, strong.robot.joint_names.index("l_knee")
    qpos = np.repeat(strong.robot.layout.to_qpos(np.array([0, 0, 5.0, 1, 0, 0, 0, *[0.0] * 8]))[None], n, axis=0)
    force = np.zeros((n, 14))
    force[:, strong.robot.layout.joint_dof[knee]] = np.linspace(0.0, 6.0 * STRONG_NM, n)
    judged = strong.stick_slip.friction(qpos, np.zeros((n, 14)), force, np.zeros((n, 12)))
    let_go = np.flatnonzero(~judged.sticks[:, knee])
    assert 0.1 * n < let_go[0] < 0.9 * n
    np.testing.assert_array_equal(let_go, np.arange(let_go[0], n))
    np.testing.assert_allclose(judged.torque[let_go, knee], -STRONG_NM, rtol=1e-9)
    assert np.argmax(judged.variance[:, knee]) == pytest.approx(let_go[0], abs=5)
    assert judged.variance[[0, -1], knee].max() < 1e-9


def test_joints_without_friction_loss_are_certain_to_have_none() -> None:
    spec = make_robot().spec.copy()
    spec.joint("l_knee").frictionloss = WEAK_NM
    robot = Robot(spec)
    knee = robot.joint_names.index("l_knee")
    stick_slip = StickSlip(robot.identification_model(FEET), robot.layout, WHITE, PERIOD_S)
    n = 50
    qpos = np.repeat(robot.layout.to_qpos(np.array([0, 0, 0.92, 1, 0, 0, 0, *[0.1] * 8]))[None], n, axis=0)
    judged = stick_slip.friction(qpos, np.zeros((n, 14)), np.zeros((n, 14)), np.zeros((n, 12)))
    others = np.arange(8) != knee
    for values in (judged.torque, judged.variance, judged.sticks):
        assert not values[:, others].any()
    assert judged.variance[:, knee].all()
