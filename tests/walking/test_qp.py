from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import nnls

from massid.typing import FloatArray
from massid.walking import Morphology, qp
from massid.walking.qp import Contact, JointTask, MotionTask, QpOptions, Solution, WholeBodyQp, minimise
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


Problem = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, int]
"""Hessian, linear term, rows, lower and upper bounds, number of equalities."""


def drawn(seed: int) -> Problem:
    """A problem of the walker's size that has a solution: 46 variables, 6 equalities, 28 limits, 22 sides of cones."""
    rng = np.random.default_rng(seed)
    root, rows, inside = rng.normal(size=(40, 46)), rng.normal(size=(56, 46)), rng.normal(size=46)
    hessian = root.T @ root + 1e-4 * np.eye(46)
    lower = rows @ inside - np.concatenate([np.zeros(6), rng.exponential(0.1, 50)])
    upper = np.concatenate([lower[:6], lower[6:34] + rng.exponential(0.1, 28) + 0.1, np.full(22, 1e30)])
    return hessian, 10.0 * rng.normal(size=46), rows, lower, np.maximum(upper, rows @ inside), 6


def walkers(monkeypatch: pytest.MonkeyPatch, seed: int, feet: tuple[int, ...]) -> Problem:
    """What the walker asks for when it is pushed and its motors are weak."""
    asked: list[Problem] = []
    with monkeypatch.context() as patch:
        patch.setattr(qp, "minimise", lambda *problem: (asked.append(problem), minimise(*problem))[1])
        solve(moving_state(seed), feet, 0.3 * PARTS.torque_limits_nm, np.array([3.0, -3.0, 1.0]))
    return asked[0]


def assert_optimal(problem: Problem, x: FloatArray | None) -> int:
    """Karush, Kuhn and Tucker's conditions, which suffice for a convex problem; gives the number of active limits.

    Multipliers are fitted to the active rows alone, and none may be below zero.
    """
    hessian, linear, rows, lower, upper, equalities = problem
    assert x is not None
    value, slack = rows @ x, 1e-9 + 1e-12 * (np.abs(rows) @ np.abs(x)).max()
    assert np.all(value >= lower - slack)
    assert np.all(value <= upper + slack)
    at_lower, at_upper = value <= lower + slack, value >= upper - slack
    pushes = np.concatenate([rows[at_lower], -rows[at_upper]])  # an equality is at both, and may push either way
    scale = (np.abs(hessian) @ np.abs(x) + np.abs(linear)).max()
    _, left = nnls(pushes.T, (hessian @ x - linear) / scale)
    assert left < 1e-12
    return len(pushes) - 2 * equalities


@pytest.mark.parametrize("seed", range(10))
def test_the_least_cost_is_found(seed: int) -> None:
    problem = drawn(seed)
    assert assert_optimal(problem, minimise(*problem)) >= 10


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("feet", [(0, 1), (0,)])
def test_the_least_cost_is_found_of_what_the_walker_asks(
    seed: int, feet: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = walkers(monkeypatch, seed, feet)
    assert problem[2].shape == ((56, 46) if len(feet) == 2 else (45, 40))
    assert assert_optimal(problem, minimise(*problem)) >= 3


def test_a_solution_that_is_off_by_little_is_not_the_least() -> None:
    problem = drawn(0)
    x = minimise(*problem)
    assert x is not None
    with pytest.raises(AssertionError):
        assert_optimal(problem, x + 1e-8 * np.abs(x).max())


@pytest.mark.parametrize("contradiction", ["bounds", "equalities", "inequalities"])
def test_contradictions_have_no_solution(contradiction: str) -> None:
    hessian, linear, rows, lower, upper, equalities = drawn(1)
    if contradiction == "bounds":
        lower[40], upper[40] = 1.0, 0.0
    elif contradiction == "equalities":
        rows[1] = rows[0]
        lower[1] = upper[1] = lower[0] + 1.0
    else:
        rows[50] = -rows[49]
        lower[49:51] = 1.0
    assert minimise(hessian, linear, rows, lower, upper, equalities) is None


@pytest.mark.parametrize("broken", [np.nan, np.inf])
@pytest.mark.parametrize("part", range(5))
@pytest.mark.parametrize("place", [0, -1])
def test_numbers_that_are_none_have_no_solution(place: int, part: int, broken: float) -> None:
    problem = drawn(2)
    parts = problem[:5]
    parts[part].flat[place] = broken
    assert minimise(*problem) is None


def test_a_cost_that_is_not_convex_has_no_solution() -> None:
    hessian, *others = drawn(3)
    assert minimise(-hessian, *others) is None


def test_a_solver_that_gives_up_has_no_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    for flag in range(-8, 0):
        monkeypatch.setattr(qp.daqp, "solve", lambda *_, flag=flag, **__: (np.zeros(46), 0.0, flag, {}))
        assert minimise(*drawn(0)) is None


def test_a_problem_is_left_as_it_was_and_may_be_a_view() -> None:
    hessian, linear, rows, lower, upper, equalities = problem = drawn(4)
    wide = np.zeros((56, 3))
    wide[:, 0], wide[:, 2] = lower, upper
    views = (hessian.T, linear, np.asfortranarray(rows), wide[:, 0], wide[:, 2], equalities)
    first, second = minimise(*views), minimise(*problem)
    assert first is not None
    assert second is not None
    assert_allclose(first, second, rtol=1e-9)
    for part, before in zip(problem[:5], drawn(4)[:5], strict=True):
        assert_allclose(part, before, rtol=0, atol=0)


def test_the_same_problem_has_the_same_solution_in_any_order_and_thread() -> None:
    problems = [drawn(seed) for seed in range(20)]
    once = [minimise(*problem) for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        again = list(pool.map(lambda problem: minimise(*problem), problems[::-1] * 5))
    for i, solution in enumerate(again):
        assert solution is not None
        assert np.array_equal(solution, once[19 - i % 20])
