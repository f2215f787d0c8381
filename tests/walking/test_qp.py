from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from massid.typing import FloatArray
from massid.walking import Morphology
from massid.walking.qp import Contact, JointTask, MotionTask, QpOptions, Solution, WholeBodyQp
from massid.walking.stance import standing_qpos
from massid.walking.state import RobotState
from massid.walking.tasks import TaskOptions, Tasks
from tests.walking.floor import nominal

MODEL = nominal("atlas")
PARTS = Morphology.from_model(MODEL)
STAND = standing_qpos(MODEL, PARTS, 0.8)


def moving_state(seed: int) -> RobotState:
    """Standing, with some motion in every joint."""
    rng = np.random.default_rng(seed)
    state = RobotState(MODEL, PARTS)
    qpos = STAND.copy()
    qpos[7:] += 0.05 * rng.normal(size=MODEL.nq - 7)
    state.update(qpos, 0.2 * rng.normal(size=MODEL.nv))
    return state


def solve(
    state: RobotState, feet: tuple[int, ...], limits: FloatArray, push: FloatArray
) -> tuple[Solution, list[Contact]]:
    tasks = Tasks(MODEL, PARTS, STAND, TaskOptions())
    contacts = [Contact(PARTS.soles[i], state.feet[i], 1 / len(feet)) for i in feet]
    motions: list[MotionTask] = [tasks.standing_foot(contact.frame) for contact in contacts]
    joints = JointTask(np.full(MODEL.nv, 0.05), -5.0 * state.qvel)
    solution = WholeBodyQp(limits).solve(state, contacts, push, np.zeros(3), motions, joints)
    assert solution is not None
    return solution, contacts


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("feet", [(0, 1), (0,), (1,)])
def test_the_solution_obeys_the_equations_of_motion(seed: int, feet: tuple[int, ...]) -> None:
    state = moving_state(seed)
    solution, contacts = solve(state, feet, PARTS.torque_limits_nm, np.array([0.3, -0.2, 0.5]))
    data = mujoco.MjData(MODEL)
    data.qpos[:], data.qvel[:] = state.qpos, state.qvel
    data.qfrc_applied[6:] = solution.torques
    jacobian = np.zeros((6, MODEL.nv))
    mujoco.mj_fwdPosition(MODEL, data)
    for contact, wrench in zip(contacts, solution.wrenches, strict=True):
        mujoco.mj_jac(MODEL, data, jacobian[:3], jacobian[3:], contact.frame.position, contact.sole.body_id)
        data.qfrc_applied[:] += jacobian.T @ wrench
    MODEL.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    mujoco.mj_forward(MODEL, data)
    # the simulator, given these torques and wrenches, accelerates as the programme said [rad/s^2]
    assert_allclose(data.qacc, solution.qacc, atol=1e-6 * np.abs(solution.qacc).max())


@pytest.mark.parametrize("feet", [(0, 1), (0,)])
def test_the_solution_keeps_limits_and_cones(feet: tuple[int, ...]) -> None:
    state, options = moving_state(7), QpOptions()
    tight = 0.4 * PARTS.torque_limits_nm
    solution, contacts = solve(state, feet, tight, np.array([3.0, 3.0, 1.0]))
    assert np.all(np.abs(solution.torques) <= tight + 1e-9)
    for contact, wrench in zip(contacts, solution.wrenches, strict=True):
        to_sole = contact.frame.rotation.T
        force, moment = to_sole @ wrench[:3], to_sole @ wrench[3:]
        slack = 1e-6  # N or N m
        assert force[2] >= -slack
        assert np.all(np.abs(force[:2]) <= options.friction * force[2] + slack)
        assert abs(moment[0]) <= options.sole_margin * contact.sole.half_width_m * force[2] + slack
        assert abs(moment[1]) <= options.sole_margin * contact.sole.half_length_m * force[2] + slack
        assert abs(moment[2]) <= options.twist_m * force[2] + slack


def test_standing_still_carries_the_weight() -> None:
    state = RobotState(MODEL, PARTS)
    state.update(STAND, np.zeros(MODEL.nv))
    solution, _ = solve(state, (0, 1), PARTS.torque_limits_nm, np.zeros(3))
    assert_allclose(solution.wrenches[:, 2].sum(), PARTS.total_mass_kg * 9.81, rtol=1e-3)
    assert_allclose(solution.qacc, 0.0, atol=0.2)


def test_a_joint_without_a_motor_gets_no_torque() -> None:
    limits = PARTS.torque_limits_nm.copy()
    passive = PARTS.arm_dofs[:2] - 6
    limits[passive] = 0.0
    solution, _ = solve(moving_state(1), (0, 1), limits, np.zeros(3))
    assert_allclose(solution.torques[passive], 0.0, atol=1e-9)


def test_without_torques_the_robot_is_let_fall() -> None:
    solution, _ = solve(moving_state(2), (0, 1), np.full(MODEL.nv - 6, 1e-3), np.zeros(3))
    assert solution.qacc[2] < -1.0


def test_a_state_that_is_no_number_has_no_solution() -> None:
    state = moving_state(2)
    state.bias[:] = np.nan
    contacts = [Contact(PARTS.soles[0], state.feet[0], 1.0)]
    motions = [MotionTask(state.pelvis.jacobian, np.zeros(6), 1.0)]
    nothing = JointTask(np.zeros(MODEL.nv), np.zeros(MODEL.nv))
    programme = WholeBodyQp(PARTS.torque_limits_nm)
    assert programme.solve(state, contacts, np.zeros(3), np.zeros(3), motions, nothing) is None
