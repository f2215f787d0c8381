from __future__ import annotations

import mujoco
import numpy as np
import pytest

from massid.model.realisation import Realisation, write_fields
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space, parameter_space
from massid.observer.bank import RobotBank
from massid.observer.injection import InertiaShapedInjection, InjectionGains, Trajectory
from massid.observer.kernels import correct_state, state_difference
from massid.observer.replay import ReplayBlock, replay_block, split
from massid.typing import FloatArray
from massid.walk import Segment
from tests.conftest import Pushed
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("friction_loss", [0.0, 1.0])
def test_zero_response_at_the_true_masses(integrator: str, friction_loss: float) -> None:
    robot = make_robot(integrator, friction_loss)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=1)
    walk = push_about(robot, space, truth, seconds=1.2)
    bank = RobotBank(robot, space, walk.contact_bodies, n_models=1)
    bank.place(truth[None])
    block = replay_block(walk, robot.layout, Segment(0, len(walk)))
    bank.restart(block)
    errors = bank.advance(block)
    assert not errors.diverged.any()
    assert np.abs(errors.values).max() < 1e-8  # SI


def test_wrong_masses_show(pushed: Pushed) -> None:
    errors = _run(pushed, np.array([pushed.truth, 1.01 * pushed.truth]))
    assert np.abs(errors[1]).max() > 1e6 * np.abs(errors[0]).max()


def test_inputs_held_through_substeps_are_those_of_a_slower_log() -> None:
    """States of every fifth step, and what acted in between: the true masses explain such a log to rounding."""
    robot, substeps, n = make_robot(), 5, 40
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=3)
    model = robot.identification_model(FEET)
    write_fields(model, robot.realise(space, truth))
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    qpos, qvel = np.empty((n + 1, model.nq)), np.empty((n + 1, model.nv))
    effort, wrench = np.zeros((n, model.nv)), 20.0 * rng.normal(size=(n, model.nu))
    effort[:, 6:] = 5.0 * rng.normal(size=(n, model.nv - 6))
    for k in range(n + 1):
        qpos[k], qvel[k] = data.qpos, data.qvel
        if k < n:
            data.qfrc_applied[:], data.ctrl[:] = effort[k], wrench[k]
            mujoco.mj_step(model, data, substeps)
    block = ReplayBlock(qpos, qvel, effort, wrench)
    for count, is_explained in ((substeps, True), (1, False)):
        bank = RobotBank(robot, space, FEET, n_models=1, timestep_s=substeps * 1e-3, substeps=count)
        assert bank.timestep_s == pytest.approx(substeps * 1e-3)
        bank.place(truth[None])
        bank.restart(block)
        assert bool(np.abs(bank.advance(block).values).max() < 1e-9) is is_explained


@pytest.mark.parametrize("threads", [1, 2])
def test_the_bank_equals_a_plain_loop_bit_for_bit(pushed: Pushed, threads: int) -> None:
    points = pushed.space.nominal * np.linspace(0.8, 1.2, 5)[:, None]
    block = replay_block(pushed.walk, pushed.robot.layout, Segment(100, 401))
    bank = _bank(pushed, 5, threads)
    bank.place(points)
    bank.restart(block)
    together = bank.advance(block).values
    for index, point in enumerate(points):
        np.testing.assert_array_equal(together[index], _plain_loop(pushed, point, block))


def test_blocks_do_not_matter(pushed: Pushed) -> None:
    points = pushed.space.nominal[None]
    window = Segment(200, 501)
    whole = _run(pushed, points, window)
    bank = _bank(pushed, 1)
    bank.place(points)
    parts = []
    for part in split(window, 50):  # a multiple of the samples for which the injection holds its mass matrix
        block = replay_block(pushed.walk, pushed.robot.layout, part)
        if part.start == window.start:
            bank.restart(block)
        parts.append(bank.advance(block).values)
    np.testing.assert_array_equal(np.concatenate(parts, axis=1), whole)


def test_a_restart_forgets_what_was_before(pushed: Pushed) -> None:
    points = pushed.space.nominal[None]
    fresh = _run(pushed, points, Segment(500, 701))
    bank = _bank(pushed, 1)
    bank.place(2.0 * points)
    for window in (Segment(0, 201), Segment(500, 701)):
        block = replay_block(pushed.walk, pushed.robot.layout, window)
        bank.restart(block)
        if window.start:
            bank.place(points)
        again = bank.advance(block).values
    np.testing.assert_array_equal(again, fresh)


def test_diverged_models_are_reported_and_the_others_go_on(pushed: Pushed, capfd: pytest.CaptureFixture[str]) -> None:
    class Explosive:
        """Feeds the error back with the wrong sign, far beyond stability, in every model that has an error."""

        carries_belief = False
        judges_friction = False

        def place(self, realisation: Realisation) -> None: ...

        def restart(self, *, follows: bool) -> None: ...

        def state_shift(self, tangent_changes: FloatArray) -> FloatArray:
            return np.zeros((len(tangent_changes), 28))

        def gains(self, block: ReplayBlock) -> InjectionGains:
            nv = block.qvel.shape[1]
            return InjectionGains(np.full((len(block), nv, 2 * nv), -1e9), None, np.ones(2 * nv))

        def shown(self, gains: InjectionGains, centre: Trajectory) -> None: ...

    bank = RobotBank(pushed.robot, pushed.space, pushed.walk.contact_bodies, n_models=2, injection=Explosive())
    block = replay_block(pushed.walk, pushed.robot.layout, Segment(0, 51))
    silent = ReplayBlock(block.qpos, block.qvel, block.effort, block.wrench)
    bank.place(np.array([pushed.truth, 1.2 * pushed.truth]))
    bank.restart(silent)
    errors = bank.advance(silent)
    assert errors.diverged[1]
    assert capfd.readouterr() == ("", "")  # the engine's own warnings are not the user's business


def test_effort_offset_acts_on_the_torque_input(pushed: Pushed) -> None:
    """A torque sensor that reads 2 N m too much is explained by an offset of 2 N m."""
    from dataclasses import replace

    space = parameter_space(pushed.robot, LINKS, ["effort_offset/l_knee"])
    effort = pushed.walk.effort.copy()
    effort[:, pushed.walk.joint_names.index("l_knee")] += 2.0
    walk = replace(pushed.walk, effort=effort)
    bank = RobotBank(pushed.robot, space, walk.contact_bodies, n_models=2)
    bank.place(np.array([[*pushed.truth, 0.0], [*pushed.truth, 2.0]]))
    block = replay_block(walk, pushed.robot.layout, Segment(0, 301))
    bank.restart(block)
    unexplained, explained = np.abs(bank.advance(block).values).max(axis=(1, 2))
    assert unexplained > 1e-3
    assert explained < 1e-8


def test_state_difference_agrees_with_mujoco_and_is_inverted_by_correct_state() -> None:
    rng = np.random.default_rng(0)
    robot = make_robot()
    model, layout = robot.model, robot.layout
    addresses = (layout.root_qpos, layout.root_dof, layout.joint_qpos, layout.joint_dof)
    for angle in (0.0, 1e-9, 0.3, 3.0):
        qpos = rng.normal(size=(1, model.nq))
        qpos[0, 3:7] /= np.linalg.norm(qpos[0, 3:7])
        qvel = rng.normal(size=(1, model.nv))
        step = rng.normal(size=model.nv)
        step[3:6] *= angle / np.linalg.norm(step[3:6])
        measured = qpos[0].copy()
        mujoco.mj_integratePos(model, measured, step, 1.0)
        measured_qvel = rng.normal(size=model.nv)
        expected = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, expected, 1.0, qpos[0], measured)

        difference = np.zeros((1, 2 * model.nv))
        state_difference(qpos, qvel, measured, measured_qvel, *addresses, difference)
        np.testing.assert_allclose(difference[0, : model.nv], expected, atol=1e-12)
        correct_state(qpos, qvel, difference, *addresses)
        state_difference(qpos, qvel, measured, measured_qvel, *addresses, difference)
        np.testing.assert_allclose(difference, 0.0, atol=1e-12)


def _bank(pushed: Pushed, n_models: int, threads: int = 0) -> RobotBank:
    return RobotBank(pushed.robot, pushed.space, pushed.walk.contact_bodies, n_models=n_models, n_threads=threads)


def _run(pushed: Pushed, points: FloatArray, window: Segment | None = None) -> FloatArray:
    bank = _bank(pushed, len(points))
    bank.place(points)
    block = replay_block(pushed.walk, pushed.robot.layout, window or Segment(0, 501))
    bank.restart(block)
    return bank.advance(block).values


def _plain_loop(pushed: Pushed, point: FloatArray, block: ReplayBlock) -> FloatArray:
    """The identification model of Eq. (23) written down once more, with one MjData."""
    robot: Robot = pushed.robot
    model = robot.identification_model(pushed.walk.contact_bodies)
    gains = InertiaShapedInjection(model).gains(block)
    write_fields(model, robot.realise(pushed.space, point))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = block.qpos[0], block.qvel[0]
    innovation = np.zeros((5, 2 * model.nv))  # the shape of the bank's, so that BLAS sums in the same order
    errors = np.empty((len(block), 2 * model.nv))
    layout = robot.layout
    addresses = (layout.root_qpos, layout.root_dof, layout.joint_qpos, layout.joint_dof)
    assert gains.force is not None
    for k in range(len(block)):
        data.qfrc_applied[:] = block.effort[k] + (innovation @ gains.force[k].T)[0]
        data.ctrl[:] = block.wrench[k]
        mujoco.mj_step(model, data)
        qpos, qvel = np.repeat(data.qpos[None], 5, 0), np.repeat(data.qvel[None], 5, 0)
        state_difference(qpos, qvel, block.qpos[k + 1], block.qvel[k + 1], *addresses, innovation)
        errors[k] = -innovation[0]
    return errors
