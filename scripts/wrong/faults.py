"""Faults of sensors, conventions, models and situations, each with the words that its warning should have."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from massid.model.robot import Robot
from massid.plant import variant
from massid.walk import Walk
from massid.walk.conventions import to_body, to_world

Situation = Literal["walk", "harness", "hanging", "lying"]
KNEE, HIP, FOOT = "l_knee", "l_hip_pitch", "l_foot"
G = 9.81


@dataclass(frozen=True)
class Fault:
    """One thing that is wrong.

    Attributes:
        words: of which one stands in the first warning if it names the right cause.
        log: what it does to a log, after the sensors' noise; None for nothing.
        robot: the true robot of which the one that is believed is a wrong model; None for the same.
        situation: what the robot does.
    """

    words: tuple[str, ...] = ()
    log: Callable[[Walk], Walk] | None = None
    robot: Callable[[Robot], Robot] | None = None
    situation: Situation = "walk"


def torques(factor: float, joint: str | None = None) -> Callable[[Walk], Walk]:
    """All torques, or those of a joint, times a factor."""

    def change(walk: Walk) -> Walk:
        effort = walk.effort.copy()
        effort[:, slice(None) if joint is None else walk.joint_names.index(joint)] *= factor
        return replace(walk, effort=effort)

    return change


def swapped_torques(walk: Walk) -> Walk:
    """Those of knee and hip under each other's names."""
    effort = walk.effort.copy()
    pair = [walk.joint_names.index(name) for name in (KNEE, HIP)]
    effort[:, pair] = effort[:, pair[::-1]]
    return replace(walk, effort=effort)


def swapped_feet(walk: Walk) -> Walk:
    """Each foot's wrench under the other's name."""
    return replace(walk, wrench=walk.wrench[:, ::-1].copy())


def forces(factor: float) -> Callable[[Walk], Walk]:
    """All wrenches times a factor."""
    return lambda walk: replace(walk, wrench=factor * walk.wrench)


def lost_foot(walk: Walk) -> Walk:
    """One foot's wrench reads zero."""
    wrench = walk.wrench.copy()
    wrench[:, walk.contact_bodies.index(FOOT)] = 0.0
    return replace(walk, wrench=wrench)


def degrees(walk: Walk) -> Walk:
    """Joint positions and velocities in degrees."""
    qpos, qvel = walk.qpos.copy(), walk.qvel.copy()
    qpos[:, 7:], qvel[:, 6:] = np.rad2deg(qpos[:, 7:]), np.rad2deg(qvel[:, 6:])
    return replace(walk, qpos=qpos, qvel=qvel)


def turned_quaternion(walk: Walk) -> Walk:
    """Read as xyzw where it was wxyz."""
    qpos = walk.qpos.copy()
    qpos[:, 3:7] = qpos[:, [6, 3, 4, 5]]
    return replace(walk, qpos=qpos)


def linear_in_body(walk: Walk) -> Walk:
    """The base's velocity as its body sees it."""
    qvel = walk.qvel.copy()
    qvel[:, :3] = to_body(walk.qpos[:, 3:7], qvel[:, :3])
    return replace(walk, qvel=qvel)


def angular_in_world(walk: Walk) -> Walk:
    """The base's turn rate as the world sees it."""
    qvel = walk.qvel.copy()
    qvel[:, 3:6] = to_world(walk.qpos[:, 3:7], qvel[:, 3:6])
    return replace(walk, qvel=qvel)


def payload(link: str, mass_kg: float) -> Callable[[Robot], Robot]:
    """A ball of lead that nobody named, fixed at a link's centre of mass."""

    def change(robot: Robot) -> Robot:
        spec = robot.spec.copy()
        where = robot.model.body(link).ipos
        inertia = 0.4 * mass_kg * 0.05**2
        ball = spec.body(link).add_body(name="payload", pos=where)
        ball.explicitinertial = True
        ball.mass, ball.inertia, ball.ipos = mass_kg, [inertia] * 3, [0.0, 0.0, 0.0]
        return Robot(spec, robot.source)

    return change


def shifted_centre(robot: Robot) -> Robot:
    """The trunk's centre of mass 3 cm to the front."""
    spec, compiled = robot.spec.copy(), robot.model.body("torso")
    body = spec.body("torso")
    body.explicitinertial = True
    body.mass, body.iquat, body.inertia = compiled.mass[0], compiled.iquat, compiled.inertia
    body.ipos, body.fullinertia = compiled.ipos + np.array([0.03, 0.0, 0.0]), np.full(6, np.nan)
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
    return Robot(spec, robot.source)


def gravity(factor: float) -> Callable[[Robot], Robot]:
    """The robot walks where everything weighs another share."""

    def change(robot: Robot) -> Robot:
        spec = robot.spec.copy()
        spec.option.gravity = [0.0, 0.0, -factor * G]
        return Robot(spec, robot.source)

    return change


FAULTS: dict[str, Fault] = {
    "nothing": Fault(),
    **{f"torques x{factor}": Fault(("torques read", "effort_scale"), torques(factor)) for factor in (1.05, 1.1, 1.3)},
    "knee's motor constant x1.1": Fault((KNEE,), torques(1.1, KNEE)),
    "knee's torque turned": Fault((KNEE,), torques(-1.0, KNEE)),
    "knee's torque dead": Fault((KNEE,), torques(0.0, KNEE)),
    "knee and hip swapped": Fault((KNEE, HIP), swapped_torques),
    "feet swapped": Fault(("swap", "other foot", "feet"), swapped_feet),
    **{f"forces x{factor}": Fault(("forces read", "wrench_scale", "weigh"), forces(factor)) for factor in (1.05, 1.1)},
    "a foot's wrench lost": Fault((FOOT, "carries"), lost_foot),
    "degrees": Fault(("degrees",), degrees),
    "quaternion order": Fault(("wxyz", "xyzw"), turned_quaternion),
    "velocity in the body": Fault(("velocity",), linear_in_body),
    "turn rate in the world": Fault(("turn rate",), angular_in_world),
    "gravity x0.9": Fault(("gravity", "weigh"), robot=gravity(0.9)),
    **{
        f"{mass_kg:g} kg on {link}": Fault((link, "payload"), robot=payload(link, mass_kg))
        for link in ("torso", "l_upper_arm", "l_forearm", "l_calf")
        for mass_kg in (1.0, 2.0, 5.0, 10.0)
    },
    "3 N m of friction": Fault(("friction",), robot=lambda robot: variant(robot, friction_loss_nm=3.0)),
    "trunk's centre 3 cm off": Fault(("com/torso", "centre of mass"), robot=shifted_centre),
    "marches in a harness": Fault(("force that", "ground", "carr"), situation="harness"),
    "hangs in a harness": Fault(("ground", "hang", "carr"), situation="hanging"),
    "lies on the floor": Fault(("ground", "force that", "carr"), situation="lying"),
}
"""By name. Payloads on torso and calf are on links that are asked for: then there is no fault, and no warning."""
