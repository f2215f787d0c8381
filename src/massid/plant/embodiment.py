"""The robot that the plant simulates: the user's file without its surroundings, driven by one motor per joint."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.model.robot import Robot
from massid.walking.morphology import torque_limits


class Integrator(StrEnum):
    """Integrators whose step has one torque."""

    EULER = "Euler"
    IMPLICITFAST = "implicitfast"
    IMPLICIT = "implicit"


_INTEGRATORS = {
    Integrator.EULER: mujoco.mjtIntegrator.mjINT_EULER,
    Integrator.IMPLICITFAST: mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    Integrator.IMPLICIT: mujoco.mjtIntegrator.mjINT_IMPLICIT,
}


def variant(
    robot: Robot, integrator: Integrator | None = None, friction_loss_nm: float | Mapping[str, float] | None = None
) -> Robot:
    """Return the robot with another integrator, or with dry friction in every joint.

    Args:
        robot: not changed.
        integrator: None for that of the file.
        friction_loss_nm: of every one-axis joint, or by joint [N m or N]; None for what the file says, as for joints
            that are not named.

    Raises:
        ModelError: no such joint.
    """
    spec = robot.spec.copy()
    if integrator is not None:
        spec.option.integrator = _INTEGRATORS[integrator]
    if friction_loss_nm is not None:
        by_joint = friction_loss_nm
        if not isinstance(by_joint, Mapping):
            by_joint = dict.fromkeys(robot.joint_names, by_joint)
        for name, loss_nm in by_joint.items():
            robot.require_joint(name)
            spec.joint(name).frictionloss = loss_nm
    return Robot(spec, robot.source)


def motorised(robot: Robot) -> Robot:
    """Return the robot alone, with torque motors.

    Floor, lights and props of the file, its keyframes and sensors are left out. Each joint that has an actuator gets a
    motor with that actuator's largest torque, so that a control is a torque [N m], in the order of the joints.

    Raises:
        ModelError: no joint has an actuator, or the robot does not compile alone.
    """
    spec = robot.spec.copy()
    world = spec.worldbody
    for group in (spec.keys, spec.sensors, world.geoms, world.sites, world.cameras, world.lights):
        for element in list(group):
            spec.delete(element)
    for body in list(world.bodies):
        if body.name != robot.root_body:
            spec.delete(body)
    alone = Robot(spec, robot.source)
    limits = torque_limits(alone.model)
    for actuator in list(spec.actuators):
        spec.delete(actuator)
    for name, limit in zip(alone.joint_names, limits, strict=True):
        if limit == 0.0:
            continue
        motor = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        motor.set_to_motor()
        # Whatever the file's default actuator says about gears and limits does not hold for this motor.
        motor.gear = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        motor.forcelimited = motor.actlimited = mujoco.mjtLimited.mjLIMITED_FALSE
        motor.ctrllimited = motor.forcelimited
        if np.isfinite(limit):
            motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
            motor.ctrlrange = np.array([-limit, limit])
    if not spec.actuators:
        raise ModelError(
            f"{robot.source}: no joint has an actuator, so nothing can move it; a URDF has none: make an MJCF file of "
            "it, with a <motor> for each joint."
        )
    return Robot(spec, robot.source)
