from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from massid.model.ground import GroundDemand, Supplied
from massid.model.inverse import DiscreteInverseDynamics, applied, recorded_steps
from massid.model.robot import Robot
from massid.typing import BoolArray
from tests.conftest import Pushed
from tests.pushed_robot import FEET, make_robot

ROWS = np.arange(200, 400)


def _given(pushed: Pushed) -> Supplied:
    layout = pushed.robot.layout
    effort = np.zeros((len(ROWS), pushed.robot.model.nv))
    effort[:, layout.joint_dof] = pushed.walk.effort[ROWS]
    steps = recorded_steps(pushed.walk, layout, ROWS)
    return Supplied(*steps, effort=effort, wrench=pushed.walk.wrench[ROWS])


def _demand(pushed: Pushed, effort_std: float = 0.4) -> GroundDemand:
    realisation = pushed.robot.realise(pushed.space, pushed.truth, FEET)
    std = np.full(pushed.robot.model.nv, 0.5)
    return GroundDemand(pushed.robot, FEET, pushed.walk.timestep_s, std, effort_std, realisation, exact=True)


def _components(*feet: int) -> BoolArray:
    unknown = np.zeros((len(ROWS), 2, 6), dtype=np.bool_)
    unknown[:, list(feet)] = True
    return unknown


@pytest.mark.parametrize("effort_std", [0.01, 10.0])
def test_with_the_true_masses_it_is_what_the_ground_exerted(pushed: Pushed, effort_std: float) -> None:
    """However the equations are weighed: none of them is at odds with another.

    Legs of four joints leave some of a wrench between the feet open; what it does to the robot is what it did.
    """
    given = _given(pushed)
    found = _demand(pushed, effort_std).wrenches(given, _components(0, 1)).wrench
    jacobian = DiscreteInverseDynamics.of(pushed.robot, FEET, pushed.walk.timestep_s).jacobian(given.position)
    np.testing.assert_allclose(applied(jacobian, found), applied(jacobian, given.wrench), atol=1e-6)
    found = _demand(pushed, effort_std).wrenches(given, _components(1)).wrench
    np.testing.assert_allclose(found, given.wrench, atol=1e-6)


def test_what_is_measured_stays_as_it_is(pushed: Pushed) -> None:
    given = _given(pushed)
    given.wrench[:, 0] += 5.0
    found = _demand(pushed).wrenches(given, _components(1)).wrench
    np.testing.assert_array_equal(found[:, 0], given.wrench[:, 0])
    assert np.abs(found[:, 1] - given.wrench[:, 1]).max() > 1.0  # the other foot has to make up for it


def test_a_straight_leg_has_no_say_in_what_moves_nothing(pushed: Pushed) -> None:
    """Stretched out and upright, feet on both sides share some wrenches in no way that motion could tell."""
    robot = make_robot()
    nv = robot.model.nv
    still, upright = np.zeros((1, nv)), robot.model.qpos0[None]
    demand = GroundDemand(robot, FEET, 1e-3, np.full(nv, 0.5), 0.4)
    found = demand.wrenches(
        Supplied(upright, still, still, still, np.zeros((1, 2, 6))), np.ones((1, 2, 6), dtype=np.bool_)
    ).wrench
    weight = robot.total_mass_kg * 9.81
    np.testing.assert_allclose(found[0, :, 2].sum(), weight, rtol=0.05)
    assert np.abs(found).max() < 2.0 * weight


def test_what_a_closed_loop_exerts_is_no_wrench_of_the_ground() -> None:
    """Knees tied to each other may push at each other as they like: through the tie, noise is a force of any size."""
    spec = make_robot().spec.copy()
    spec.add_equality(type=mujoco.mjtEq.mjEQ_JOINT, name1="l_knee", name2="r_knee", objtype=mujoco.mjtObj.mjOBJ_JOINT)
    robot = Robot(spec)
    nv, channels = robot.model.nv, robot.channels(FEET)
    still, upright = np.zeros((1, nv)), robot.model.qpos0[None].copy()
    upright[0, robot.layout.joint_qpos] += 0.05
    against = 50.0 * (np.eye(nv)[channels.dof("l_knee")] - np.eye(nv)[channels.dof("r_knee")])[None]
    demand = GroundDemand(robot, FEET, 1e-3, np.full(nv, 0.5), 0.4)
    idle, pushing, bent = (
        demand.wrenches(
            Supplied(upright, still, still, effort, np.zeros((1, 2, 6))), np.ones((1, 2, 6), dtype=np.bool_)
        ).wrench
        for effort in (still, against, np.abs(against))
    )
    np.testing.assert_allclose(pushing, idle, atol=0.1)
    assert np.abs(bent - idle).max() > 10.0


def test_more_wrenches_than_the_motion_can_tell_are_in_doubt(pushed: Pushed) -> None:
    """Four bodies, 24 components, 14 equations; of two feet, the sum is known well."""
    given = _given(pushed)
    bodies = (*FEET, "l_calf", "r_calf")
    std = np.full(pushed.robot.model.nv, 0.5)
    weight = pushed.robot.total_mass_kg * 9.81

    def doubts(bodies: tuple[str, ...]) -> tuple[float, float]:
        wrench, unknown = np.zeros((len(ROWS), len(bodies), 6)), np.ones((len(ROWS), len(bodies), 6), dtype=np.bool_)
        demand = GroundDemand(pushed.robot, bodies, pushed.walk.timestep_s, std, 0.4)
        spread = demand.wrenches(replace(given, wrench=wrench), unknown).spread[0, :, 2]
        return float(np.linalg.norm(spread, axis=1).max()), float(np.linalg.norm(spread.sum(axis=0)))

    single, together = doubts(bodies)
    assert single > 0.3 * weight
    assert together < 0.1 * weight
    assert max(doubts(FEET)) < 0.1 * weight
