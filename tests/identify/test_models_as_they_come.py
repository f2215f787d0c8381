"""Short clean logs of robots whose files do more than describe a robot: the masses come out, or the cause is named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from massid import weigh
from massid.audit import prepare_walk
from massid.identify import IdentifyOptions
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.observer.sensors import NoisySensors
from massid.plant import sensors_of
from massid.result import Result
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Walk
from massid.weighing import Weighing
from tests.pushed_robot import LINKS, draw_truth, make_robot, push_about

OPTIONS = IdentifyOptions(dwell_s=0.25)
Change = Callable[[mujoco.MjSpec], None]


def robot_with(change: Change) -> Robot:
    """The biped with a change in its file."""
    spec = make_robot().spec.copy()
    change(spec)
    return Robot(spec, "robot.xml")


def truth_of(robot: Robot) -> tuple[ParameterSpace, FloatArray]:
    space = mass_space(robot, LINKS)
    return space, draw_truth(space, seed=3)


def weighed(walk: Walk, robot: Robot) -> Result:
    """All but the verdict, which takes longest."""
    job = Weighing.prepare(walk, robot, LINKS, held_out=0.0, options=OPTIONS)
    return job.check(job.identify())


def _arms(spec: mujoco.MjSpec, gravcomp: float = 0.0, by_actuator: bool = False) -> None:
    for side, y in (("l", 0.25), ("r", -0.25)):
        arm = spec.body("torso").add_body(name=f"{side}_arm", pos=[0, y, 0.2], gravcomp=gravcomp)
        joint = arm.add_joint(name=f"{side}_shoulder", axis=[0, 1, 0], actgravcomp=by_actuator)
        joint.armature, joint.damping = 0.01, [0.2, 0.0, 0.0]
        arm.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=[0, 0, 0, 0.2, 0, -0.3], size=[0.03, 0, 0], mass=3.0)
        spec.add_actuator(name=f"{side}_arm", target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)


def balloons(spec: mujoco.MjSpec) -> None:
    """Arms without weight."""
    _arms(spec, gravcomp=1.0)


def compensated(spec: mujoco.MjSpec) -> None:
    """Arms whose motors bear a part of their weight by themselves."""
    _arms(spec, gravcomp=0.7, by_actuator=True)


def rotors(spec: mujoco.MjSpec) -> None:
    """Motors with rotors and dampers, on a joint's parent and on a tendon."""
    _arms(spec)
    left, right = (spec.actuator(f"{side}_arm") for side in "lr")
    left.trntype, left.armature, left.gear[0] = mujoco.mjtTrn.mjTRN_JOINTINPARENT, 0.1, 2.0
    tendon = spec.add_tendon(name="belt")
    tendon.wrap_joint("r_shoulder", 1.5)
    right.trntype, right.target, right.armature = mujoco.mjtTrn.mjTRN_TENDON, "belt", 0.1
    right.damping = np.array([0.3, *np.ravel(right.damping)[1:]])
    right.gear[0] = 2.0


def closed_loop(spec: mujoco.MjSpec, timeconst: float = 0.02) -> None:
    """Arms that hold each other."""
    _arms(spec)
    tie = spec.add_equality(name="held", type=mujoco.mjtEq.mjEQ_CONNECT, objtype=mujoco.mjtObj.mjOBJ_BODY)
    tie.name1, tie.name2, tie.data[:3], tie.solref = "l_arm", "r_arm", [0.2, -0.25, -0.3], [timeconst, 1.0]


@pytest.mark.parametrize("change", [balloons, compensated, rotors, closed_loop])
def test_what_drives_or_ties_joints_is_neither_lost_nor_counted_twice(change: Change) -> None:
    robot = robot_with(change)
    space, truth = truth_of(robot)
    result = weighed(push_about(robot, space, truth, seconds=0.8), robot)
    np.testing.assert_allclose(result.estimate, truth, atol=1e-6)
    assert result.warnings == ()


@pytest.mark.parametrize(
    ("change", "logged", "said"),
    [
        (compensated, "motors", "the logged torques lack what compensates gravity"),
        (balloons, "real", "nothing of the robot's weight was borne"),
    ],
)
def test_what_a_log_makes_of_gravity_compensation_is_read_off_it(change: Change, logged: str, said: str) -> None:
    robot = robot_with(change)
    plant = robot.without_gravcomp() if logged == "real" else robot
    space, truth = truth_of(robot)
    walk = push_about(plant, space, truth, seconds=0.8)
    if logged == "motors":
        walk = robot.without_compensation(walk)
    result = weighed(walk, robot)
    np.testing.assert_allclose(result.estimate, truth, atol=1e-6)
    (warning,) = result.warnings
    assert said in warning


def test_a_weight_that_actuators_bear_is_told_of_a_link_that_is_asked_for() -> None:
    robot = robot_with(compensated)
    space, truth = truth_of(robot)
    walk = push_about(robot, space, truth, seconds=0.6)
    job = Weighing.prepare(walk, robot, ["torso", "l_arm"], held_out=0.0, options=OPTIONS)
    assert any("actuators compensate the weight of l_arm" in warning for warning in job.warnings)


def test_a_step_that_was_set_in_code_is_read_off_the_log() -> None:
    slow = robot_with(lambda spec: setattr(spec.option, "timestep", 0.002))
    space, truth = truth_of(slow)
    walk = push_about(slow, space, truth, seconds=1.6)
    walk = replace(walk, timestep_s=0.002, stamps_ns=walk.stamps_ns * 2)
    result = weighed(walk, make_robot())  # whose file says 1 ms
    np.testing.assert_allclose(result.estimate, truth, atol=1e-6)
    assert any("simulated with steps of its own sample period, 0.002 s" in warning for warning in result.warnings)


def _every(walk: Walk, stride: int) -> Walk:
    """Every so many states, and the means of what acted."""
    n = len(walk) // stride * stride

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(values[:n].reshape(n // stride, stride, *values.shape[1:]).mean(axis=1))

    return replace(
        walk, stamps_ns=walk.stamps_ns[:n:stride], qpos=walk.qpos[:n:stride], qvel=walk.qvel[:n:stride],
        effort=mean(walk.effort), wrench=mean(walk.wrench), timestep_s=walk.timestep_s * stride, segments=(),
    )  # fmt: skip


def test_a_clean_log_of_every_tenth_step_is_weighed_as_if_sensors_had_noise() -> None:
    robot = make_robot()
    space, truth = truth_of(robot)
    walk = _every(push_about(robot, space, truth, seconds=2.0), 10)
    options = IdentifyOptions(passes=3)
    result = weigh(walk, robot, LINKS, held_out=0.0, checks=False, options=options)
    assert result.uncertainty is not None
    error = np.abs(result.estimate - truth)
    assert (error < 4.0 * result.uncertainty.std).all()
    assert np.linalg.norm(error) < 0.15 * np.linalg.norm(space.nominal - truth)
    assert any("its samples are far apart" in warning for warning in result.warnings)
    # Whoever says that it is clean gets states put between its samples.
    clean = Weighing.prepare(walk, robot, LINKS, held_out=0.0, options=IdentifyOptions(noise="clean"))
    assert not isinstance(clean.logs[0].sensors, NoisySensors)
    assert len(clean.logs[0].walk) > 9 * len(walk)


@pytest.mark.parametrize("solver", ["PGS", "NEWTON"])
def test_a_solver_that_stops_early_is_named(solver: str) -> None:
    def hasty(spec: mujoco.MjSpec) -> None:
        spec.option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver}")
        spec.option.iterations, spec.option.ls_iterations = 2, 4
        for joint in spec.joints[1:]:
            joint.frictionloss = 1.0

    robot = robot_with(hasty)
    space, truth = truth_of(robot)
    (warning,) = prepare_walk(push_about(robot, space, truth, seconds=0.8), robot).audit.warnings
    assert f"the {solver} solver stops after 2 iterations" in warning


def test_a_model_without_gravity_is_named() -> None:
    robot = make_robot()
    space, truth = truth_of(robot)
    walk = push_about(robot, space, truth, seconds=0.8)
    weightless = robot_with(lambda spec: setattr(spec.option, "gravity", [0.0, 0.0, 0.0]))
    assert any("the model has no gravity" in line for line in prepare_walk(walk, weightless).audit.warnings)


def test_noise_through_a_stiff_tie_is_no_unexplained_force() -> None:
    robot = robot_with(lambda spec: closed_loop(spec, timeconst=0.002))
    space, truth = truth_of(robot)
    walk = push_about(robot, space, truth, seconds=0.8)
    noisy = sensors_of(walk, "realistic", 0).measure(walk)
    assert prepare_walk(noisy, robot).audit.warnings == ()
    turned = replace(noisy, effort=-noisy.effort)  # a fault is still one
    assert any("explained neither" in line for line in prepare_walk(turned, robot).audit.warnings)


def test_a_noisy_log_of_a_hundred_samples_a_second_is_judged() -> None:
    robot = make_robot()
    space, truth = truth_of(robot)
    coarse = _every(push_about(robot, space, truth, seconds=1.5), 10)
    noisy = sensors_of(coarse, "white", 0).measure(coarse)
    assert Weighing.prepare(noisy, robot, LINKS, held_out=0.0).foresee().std.max() < 1.0
