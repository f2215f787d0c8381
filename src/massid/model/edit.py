"""Changes to a robot's spec: into the model of Eq. (22), with some joints held still, or with other bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.model.scenery import drop_references
from massid.typing import FloatArray

SOLVER_ITERATIONS = 100
SOLVER_TOLERANCE = 1e-14
LINE_SEARCH_ITERATIONS = 50
"""The engine's constraint solver must not add its own error; models shipped for games stop it after 3 iterations."""
WRENCH_SITE_PREFIX = "massid_wrench/"
"""Of the sites that measured wrenches act at."""


def unseen_spec(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a spec without what is only seen: skins, textures, and meshes that nothing collides with.

    Bodies keep the inertia that follows from such meshes.
    """
    spec = spec.copy()
    for skin in list(spec.skins):
        spec.delete(skin)
    spec.discard_visual()
    return spec


def bare_spec(spec: mujoco.MjSpec) -> mujoco.MjSpec:
    """Return a copy of a spec that has nothing but what moves: no actuators, no contacts, nothing to be seen."""
    spec = spec.copy()
    drop_shapes(spec)
    keep_actuator_dynamics(spec)
    lift_force_limits(spec)
    for group in (spec.keys, spec.actuators, spec.sensors, spec.tuples):
        for element in list(group):
            spec.delete(element)
    set_options(spec.option)
    return spec


def identification_spec(bare: mujoco.MjSpec, contact_bodies: Sequence[str]) -> mujoco.MjSpec:
    """Return a copy of a bare spec, driven by generalised forces and by six motors at each contact body's origin.

    Args:
        bare: see `bare_spec`.
        contact_bodies: bodies of it; controls are ordered like them.
    """
    spec = bare.copy()
    for body_name in contact_bodies:
        site = spec.body(body_name).add_site(name=f"{WRENCH_SITE_PREFIX}{body_name}")
        for axis in range(6):
            gear = np.zeros(6)
            gear[axis] = 1.0
            motor = spec.add_actuator(
                name=f"{site.name}/{axis}", trntype=mujoco.mjtTrn.mjTRN_SITE, target=site.name, gear=gear
            )
            make_plain_motor(motor)
    return spec


def lift_force_limits(spec: mujoco.MjSpec) -> None:
    """Let joints and tendons bear any actuator force.

    The engine clamps the sum of all actuators' forces on a joint (`actuatorfrcrange`). Measured wrenches act through
    motors, so on nearly every commercial robot's model J^T f would be cut off at loaded samples; and what was measured
    has been within the limits of the real drives.
    """
    for element in (*spec.joints, *spec.tendons):
        element.actfrclimited = mujoco.mjtLimited.mjLIMITED_FALSE


def drop_shapes(spec: mujoco.MjSpec) -> None:
    """Take out what is only seen or touched: each of many copies would hold all of a robot's meshes and textures.

    Bodies keep the inertia that followed from their geoms, and tendons the geoms that they wrap around.
    """
    for skin in list(spec.skins):
        spec.delete(skin)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    spec.discard_visual()


def make_plain_motor(motor: Any) -> None:
    """Undo whatever the file's default class says about actuators: one unit of control is one unit of force."""
    motor.set_to_motor()
    no = mujoco.mjtLimited.mjLIMITED_FALSE
    motor.ctrllimited = motor.forcelimited = motor.actlimited = no
    motor.armature = 0.0
    motor.damping = np.zeros_like(motor.damping)
    motor.delay, motor.nsample, motor.group, motor.actearly = 0.0, 0, 0, False


def set_options(option: Any) -> None:
    """Contacts off, the robot's own actuators off, and a constraint solver that adds no error of its own.

    Flags that check the engine (fwdinv, which stops RK4 with an error), or that another solver or contacts need, go.
    """
    disable, enable = mujoco.mjtDisableBit, mujoco.mjtEnableBit
    option.disableflags |= int(disable.mjDSBL_CONTACT | disable.mjDSBL_AUTORESET)
    option.disableflags &= ~int(disable.mjDSBL_ACTUATION)
    option.enableflags &= ~int(
        enable.mjENBL_SLEEP | enable.mjENBL_FWDINV | enable.mjENBL_INVDISCRETE | enable.mjENBL_IPC
    )
    option.disableactuator = 0
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.iterations, option.tolerance = SOLVER_ITERATIONS, SOLVER_TOLERANCE
    option.ls_iterations = max(option.ls_iterations, LINE_SEARCH_ITERATIONS)
    option.noslip_iterations = 0


def without_joints(spec: mujoco.MjSpec, model: mujoco.MjModel, positions: Mapping[str, float]) -> mujoco.MjSpec:
    """Return a copy of a spec in which some joints are held still.

    Args:
        spec: as loaded.
        model: its compiled form.
        positions: by joint, where it is held [rad or m].

    Raises:
        ModelError: one of several joints of a body is to be held away from the model's own position.
    """
    data = mujoco.MjData(model)
    for name, position in positions.items():
        data.qpos[model.joint(name).qposadr[0]] = position
    mujoco.mj_kinematics(model, data)
    spec = spec.copy()
    drop_references(spec, set(positions))
    for name in positions:
        _lock_joint(spec, model, data, name)
    return spec


def _lock_joint(spec: mujoco.MjSpec, model: mujoco.MjModel, data: mujoco.MjData, name: str) -> None:
    """Take a joint out of a spec and leave its body where the joint holds it."""
    joint, index = spec.joint(name), model.joint(name).id
    body = int(model.jnt_bodyid[index])
    address = int(model.jnt_qposadr[index])
    if data.qpos[address] != model.qpos0[address]:
        if model.body_jntnum[body] != 1:
            raise ModelError(
                f"Joint '{name}' shares its body with another joint, so it can only be held at the model's own "
                f"position {model.qpos0[address]:g}, not at {data.qpos[address]:g}."
            )
        parent = int(model.body_parentid[body])
        inverse, inverse_pos = np.zeros(4), np.zeros(3)
        mujoco.mju_negPose(inverse_pos, inverse, data.xpos[parent], data.xquat[parent])
        position, attitude = np.zeros(3), np.zeros(4)
        mujoco.mju_mulPose(position, attitude, inverse_pos, inverse, data.xpos[body], data.xquat[body])
        spec_body = joint.parent
        spec_body.pos, spec_body.quat = position, attitude
        spec_body.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    spec.delete(joint)


def keep_actuator_dynamics(spec: mujoco.MjSpec) -> None:
    """Hand armature and damping of actuators to the joints and tendons that they drive: the actuators are about to go.

    What compensates gravity acts passively then. The torques that it made are taken off the measured ones
    (`Robot.without_compensation`), or they would count twice.
    """
    transmission = mujoco.mjtTrn
    for actuator in spec.actuators:
        if actuator.trntype in (transmission.mjTRN_JOINT, transmission.mjTRN_JOINTINPARENT):
            driven = spec.joint(actuator.target)
        elif actuator.trntype == transmission.mjTRN_TENDON:
            driven = spec.tendon(actuator.target)
        else:
            continue
        if driven is None:
            continue
        ratio = float(actuator.gear[0]) ** 2
        driven.armature += ratio * np.ravel(actuator.armature)[0]
        driven.damping = np.asarray(driven.damping) + ratio * np.asarray(actuator.damping)
    for joint in spec.joints:
        joint.actgravcomp = False


def is_rescaled(spec: mujoco.MjSpec) -> bool:
    """Whether the compiler does not take the bodies' inertia as it is given."""
    compiler = spec.compiler
    rescaled = compiler.settotalmass > 0 or compiler.boundmass > 0 or compiler.boundinertia > 0
    return bool(rescaled or compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE)


def write_bodies(
    spec: mujoco.MjSpec, model: mujoco.MjModel, bodies: Sequence[int], fields: Mapping[str, FloatArray]
) -> None:
    """Write bodies as they are in the first row of model fields, whether their inertia was given or came from geoms.

    Args:
        spec: changed: its compiler takes the bodies' inertia as it is given now.
        model: as compiled from it before.
        bodies: numbers of those that can differ from the model.
        fields: MjModel field name -> values, shape (N, *field shape).
    """
    compiler = spec.compiler
    if is_rescaled(spec):
        bodies = range(1, model.nbody)
        compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        compiler.settotalmass, compiler.boundmass, compiler.boundinertia = -1.0, 0.0, 0.0
    ipos = fields.get("body_ipos", model.body_ipos[None])
    iquat = fields.get("body_iquat", model.body_iquat[None])
    for number in bodies:
        name = model.body(number).name
        body = spec.body(name) if name else spec.bodies[number]
        body.explicitinertial = True
        body.mass = float(fields["body_mass"][0, number])
        body.ipos = ipos[0, number]
        body.iquat = iquat[0, number]
        body.inertia = fields["body_inertia"][0, number]
        body.fullinertia = np.full(6, np.nan)
