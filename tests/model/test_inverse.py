"""Inverse dynamics of recorded steps must give back what acted in them, whatever the integrator."""

from __future__ import annotations

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from massid.model.inverse import DiscreteInverseDynamics, applied, recorded_steps
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.typing import FloatArray
from tests.conftest import Pushed
from tests.pushed_robot import FEET, LINKS, draw_truth, make_robot, push_about

STEPS = 40
SINGLE_STAGE = ("Euler", "implicit", "implicitfast", "discrete")
EULERDAMP, DAMPER = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP), int(mujoco.mjtDisableBit.mjDSBL_DAMPER)


def _robot(integrator: str, disabled: int = 0, timestep_s: float = 1e-3) -> Robot:
    """The biped with whatever joints can have: dampers, springs, armature, dry friction, limits, a tendon."""
    spec = make_robot(integrator, friction_loss=0.5, disabled=disabled).spec.copy()
    spec.option.timestep = timestep_s
    for joint in spec.joints:
        if joint.name != "root":
            joint.damping, joint.stiffness = np.array([2.0, 0.0, 0.0]), np.array([30.0, 0.0, 0.0])
    knee = spec.joint("l_knee")
    knee.limited, knee.range = mujoco.mjtLimited.mjLIMITED_TRUE, [-0.02, 0.02]
    tendon = spec.add_tendon(name="hips")
    tendon.stiffness, tendon.damping = np.array([20.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])
    for name, coefficient in (("l_hip_pitch", 1.0), ("r_hip_pitch", -0.5)):
        tendon.wrap_joint(name, coefficient)
    return Robot(spec)


def _steps(robot: Robot) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Steps of an identification model from any states: positions, velocities, accelerations, torques, wrenches."""
    rng = np.random.default_rng(0)
    model = robot.identification_model(FEET)
    data = mujoco.MjData(model)
    qpos, qvel, qacc = np.empty((STEPS, model.nq)), np.empty((STEPS, model.nv)), np.empty((STEPS, model.nv))
    torque, wrench = np.zeros((STEPS, model.nv)), 30.0 * rng.normal(size=(STEPS, len(FEET), 6))
    torque[:, 6:] = 20.0 * rng.normal(size=(STEPS, model.nv - 6))
    for k in range(STEPS):
        attitude = rng.normal(size=4)
        qpos[k] = [*rng.normal(size=3), *(attitude / np.linalg.norm(attitude)), *(0.3 * rng.normal(size=model.nq - 7))]
        qvel[k] = rng.normal(size=model.nv)
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = qpos[k], qvel[k], 0.0
        data.qfrc_applied[:], data.ctrl[:] = torque[k], wrench[k].ravel()
        mujoco.mj_step(model, data)
        qacc[k] = (data.qvel - qvel[k]) / model.opt.timestep
    return qpos, qvel, qacc, torque, wrench


def _relative_error(robot: Robot) -> float:
    """Between the force that acted over steps and what their inverse dynamics say."""
    qpos, qvel, qacc, torque, wrench = _steps(robot)
    dynamics = DiscreteInverseDynamics.of(robot, FEET, float(robot.model.opt.timestep))
    acted = torque + applied(dynamics.jacobian(qpos), wrench)
    return float(np.linalg.norm(dynamics.forces(qpos, qvel, qacc) - acted) / np.linalg.norm(acted))


@pytest.mark.parametrize("disabled", [0, EULERDAMP, DAMPER])
@pytest.mark.parametrize("integrator", SINGLE_STAGE)
def test_what_acted_over_a_step_is_found_to_rounding(integrator: str, disabled: int) -> None:
    assert _relative_error(_robot(integrator, disabled)) < 1e-11


def test_for_runge_kutta_it_is_found_to_first_order_in_the_step() -> None:
    """Its step is taken for one of Euler's: what acts at its start for what acted on average over four stages."""
    errors = [_relative_error(_robot("RK4", timestep_s=step_s)) for step_s in (1e-3, 5e-4, 2.5e-4)]
    assert errors[0] < 0.2  # one knee hits its limit
    for longer, shorter in pairwise(errors):
        assert longer / shorter == pytest.approx(2.0, rel=0.2)


@pytest.mark.parametrize("integrator", SINGLE_STAGE)
def test_torques_and_wrenches_of_a_log_are_what_its_steps_took(integrator: str) -> None:
    robot = _robot(integrator)
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=1)
    walk = push_about(robot, space, truth, seconds=0.2)
    dynamics = DiscreteInverseDynamics.of(robot, FEET, walk.timestep_s, robot.realise(space, truth, FEET))
    rows = np.arange(20, len(walk) - 1)
    steps = recorded_steps(walk, robot.layout, rows)
    acted = applied(dynamics.jacobian(steps[0]), walk.wrench[rows])
    acted[:, robot.layout.joint_dof] += walk.effort[rows]
    assert np.abs(walk.wrench[rows]).max() > 50.0  # it stands on its feet
    np.testing.assert_allclose(dynamics.forces(*steps), acted, rtol=0.0, atol=1e-8 * np.abs(acted).max())


def test_wrenches_act_as_the_motors_of_the_identification_model_do(pushed: Pushed) -> None:
    model = pushed.robot.identification_model(FEET)
    data = mujoco.MjData(model)
    rows = np.arange(0, len(pushed.walk), 50)
    qpos, wrench = pushed.robot.layout.to_qpos(pushed.walk.qpos[rows]), pushed.walk.wrench[rows]
    found = applied(DiscreteInverseDynamics(model, FEET).jacobian(qpos), wrench)
    for k in range(len(rows)):
        data.qpos[:], data.ctrl[:] = qpos[k], wrench[k].ravel()
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(found[k], data.qfrc_actuator, rtol=0.0, atol=1e-12 * np.abs(wrench).max())


def test_the_model_is_left_as_it_was(pushed: Pushed) -> None:
    model = make_robot("RK4").identification_model(FEET)
    before = model.opt.integrator, model.opt.enableflags, model.opt.disableflags
    DiscreteInverseDynamics(model, FEET).forces(*recorded_steps(pushed.walk, pushed.robot.layout, np.arange(3)))
    assert (model.opt.integrator, model.opt.enableflags, model.opt.disableflags) == before
