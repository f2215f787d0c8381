"""The walking humanoid with one trait at a time of other people's model files, and robots that nobody here wrote."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from pathlib import Path

import dm_control
import mujoco
import numpy as np

from massid.assets import resolve_model
from massid.model.robot import Robot

SUITE = Path(dm_control.__file__).parent / "suite"


def atlas_spec() -> mujoco.MjSpec:
    """The shipped robot."""
    return mujoco.MjSpec.from_file(str(resolve_model("atlas")))


def _one_axis(spec: mujoco.MjSpec) -> list[mujoco.MjsJoint]:
    return [joint for joint in spec.joints if joint.type != mujoco.mjtJoint.mjJNT_FREE]


def plain(spec: mujoco.MjSpec, folder: Path) -> None:
    """The robot as it is."""


def include_and_meshes(spec: mujoco.MjSpec, folder: Path) -> None:
    """Soles are meshes from a folder of their own; assets come from an include file."""
    (folder / "meshes").mkdir(parents=True, exist_ok=True)
    spec.compiler.meshdir = "meshes"
    meshes = []
    for geom in list(spec.geoms):
        if geom.type != mujoco.mjtGeom.mjGEOM_BOX or not (geom.conaffinity or geom.contype):
            continue
        name = f"box{len(meshes)}"
        corners = [np.array(signs) * geom.size for signs in itertools.product((-1, 1), repeat=3)]
        faces = "1 3 7 5 1 7|2 6 8 2 8 4|1 5 6 1 6 2|3 4 8 3 8 7|1 2 4 1 4 3|5 7 8 5 8 6"
        text = "".join(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in corners)
        for face in faces.split("|"):
            a = face.split()
            text += f"f {a[0]} {a[1]} {a[2]}\nf {a[3]} {a[4]} {a[5]}\n"
        (folder / "meshes" / f"{name}.obj").write_text(text)
        meshes.append(f'<mesh name="{name}" file="{name}.obj"/>')
        spec.add_mesh(name=name, file=f"{name}.obj")
        geom.type, geom.meshname = mujoco.mjtGeom.mjGEOM_MESH, name
    spec.modelfiledir = str(folder)
    xml = spec.to_xml()
    for line in meshes:
        name = line.split('"')[1]
        start = xml.index(f'<mesh name="{name}"')
        xml = xml[:start] + xml[xml.index("/>", start) + 2 :]
    xml = xml.replace("<asset>", '<include file="parts/assets.xml"/>\n  <asset>', 1)
    (folder / "parts").mkdir(exist_ok=True)
    (folder / "parts" / "assets.xml").write_text(f"<mujoco><asset>{''.join(meshes)}</asset></mujoco>")
    (folder / "robot.xml").write_text(xml)


def _servos(spec: mujoco.MjSpec, kp: float, kv: float) -> None:
    for actuator in spec.actuators:
        actuator.ctrllimited = mujoco.mjtLimited.mjLIMITED_FALSE
        if kp:
            actuator.set_to_position(kp=kp, kv=kv)
        else:
            actuator.set_to_velocity(kv=kv)


def position_servos(spec: mujoco.MjSpec, folder: Path) -> None:
    """Position actuators with damping, Euler."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    _servos(spec, 500.0, 10.0)


def velocity_servos(spec: mujoco.MjSpec, folder: Path) -> None:
    """Velocity actuators under an implicit integrator."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    _servos(spec, 0.0, 20.0)


def friction_loss(spec: mujoco.MjSpec, folder: Path) -> None:
    """Dry friction in all joints."""
    for joint in _one_axis(spec):
        joint.frictionloss = 1.0


def joint_limits(spec: mujoco.MjSpec, folder: Path) -> None:
    """Limits into which arms and neck are pressed by springs."""
    for joint in _one_axis(spec):
        if "arm" in joint.name or "neck" in joint.name:
            joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
            joint.range = [-0.02, 0.02]
            joint.springref, joint.stiffness = 0.3, [50.0, 0.0, 0.0] if np.ndim(joint.stiffness) else 50.0


def equality(spec: mujoco.MjSpec, folder: Path) -> None:
    """Elbows coupled, and the hands' wrists tied to each other by polynomials."""
    for side in "lr":
        elbows = [j.name for j in _one_axis(spec) if j.name.startswith(f"{side}_arm")]
        row = spec.add_equality(name=f"{side}_couple", type=mujoco.mjtEq.mjEQ_JOINT, name1=elbows[-1], name2=elbows[-2])
        row.data[:5] = [0.0, 0.5, 0.1, 0.0, 0.0]


def tendons(spec: mujoco.MjSpec, folder: Path) -> None:
    """Springy tendons across both shoulders."""
    for side in "lr":
        names = [j.name for j in _one_axis(spec) if j.name.startswith(f"{side}_arm")]
        tendon = spec.add_tendon(name=f"{side}_tendon")
        tendon.stiffness, tendon.damping = _scalar(tendon.stiffness, 20.0), _scalar(tendon.damping, 1.0)
        for name, coefficient in zip(names[:3], (1.0, -0.5, 0.3), strict=True):
            tendon.wrap_joint(name, coefficient)


def _scalar(like: object, value: float) -> object:
    return np.array([value] + [0.0] * (np.size(like) - 1)) if np.ndim(like) else value


def euler(spec: mujoco.MjSpec, folder: Path) -> None:
    """Euler."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER


def implicitfast(spec: mujoco.MjSpec, folder: Path) -> None:
    """The implicitfast integrator."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST


def implicit(spec: mujoco.MjSpec, folder: Path) -> None:
    """The implicit integrator."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT


def runge_kutta(spec: mujoco.MjSpec, folder: Path) -> None:
    """Runge-Kutta, which has no single torque and wrench per step."""
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4


def three_iterations(spec: mujoco.MjSpec, folder: Path) -> None:
    """A solver that stops after three iterations, with dry friction for it to solve."""
    friction_loss(spec, folder)
    spec.option.iterations, spec.option.ls_iterations = 3, 5
    spec.option.solver = mujoco.mjtSolver.mjSOL_PGS


def default_classes(spec: mujoco.MjSpec, folder: Path) -> None:
    """A default class that spoils every new actuator, and an actuator group switched off."""
    general = spec.default.actuator
    general.ctrllimited, general.ctrlrange = mujoco.mjtLimited.mjLIMITED_TRUE, [-1, 1]
    general.gear = [50, 0, 0, 0, 0, 0]
    general.damping = _scalar(general.damping, 0.2)
    general.armature = _scalar(general.armature, 0.01)
    general.group = 1
    spec.option.disableactuator = 2


def inertia_from_geoms(spec: mujoco.MjSpec, folder: Path) -> None:
    """Inertia computed from geoms, given inertials ignored."""
    model = spec.copy().compile()
    for body in spec.bodies:
        mass = float(model.body(body.name).mass[0])
        if body.name != "world" and mass > 0 and body.geoms:
            volume_share = 1.0 / len(body.geoms)
            for geom in body.geoms:
                geom.mass = mass * volume_share
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    spec.compiler.boundmass, spec.compiler.boundinertia = 0.05, 1e-4


def welded_bodies(spec: mujoco.MjSpec, folder: Path) -> None:
    """A backpack of two bodies on the torso, and shoes: bodies without joints."""
    pack = spec.body("torso").add_body(name="backpack", pos=[-0.3, 0, 0.3])
    pack.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.05, 0.1, 0.1], mass=4.0, contype=0, conaffinity=0)
    pocket = pack.add_body(name="pocket", pos=[-0.1, 0, 0])
    pocket.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.03, 0, 0], mass=1.0, contype=0, conaffinity=0)


def scenery(spec: mujoco.MjSpec, folder: Path) -> None:
    """A door with a motor, a ball and a lamp on a chain; one of the robot's own bodies has no name."""
    door = spec.worldbody.add_body(name="door", pos=[9, 0, 1])
    door.add_joint(name="door", axis=[0, 0, 1])
    spec.add_actuator(name="door", target="door", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    ball = spec.worldbody.add_body(name="ball", pos=[9, 3, 0.2])
    ball.add_freejoint()
    lamp = spec.worldbody.add_body(pos=[9, 6, 3])
    lamp.add_joint(type=mujoco.mjtJoint.mjJNT_BALL)
    pack = spec.body("torso").add_body(pos=[-0.3, 0, 0.3])
    for body in (door, ball, lamp, pack):
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0, 0], mass=2.0, contype=0, conaffinity=0)


def tied_to_the_world(spec: mujoco.MjSpec, folder: Path) -> None:
    """A weld that holds the torso, which the simulation has let go."""
    spec.add_equality(
        name="hook", type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1="torso", active=False
    )


def _arm_bodies(spec: mujoco.MjSpec) -> list[mujoco.MjsBody]:
    return [joint.parent for joint in _one_axis(spec) if "arm" in joint.name]


def weightless_arms(spec: mujoco.MjSpec, folder: Path) -> None:
    """Arms whose weight the model bears."""
    for body in _arm_bodies(spec):
        body.gravcomp = 1.0


def compensated_arms(spec: mujoco.MjSpec, folder: Path) -> None:
    """Arms whose weight their actuators bear, and log."""
    weightless_arms(spec, folder)
    for joint in _one_axis(spec):
        joint.actgravcomp = "arm" in joint.name


TRAITS: Mapping[str, Callable[[mujoco.MjSpec, Path], None]] = {
    "none": plain,
    "include files, meshes": include_and_meshes,
    "position servos": position_servos,
    "velocity servos, implicitfast": velocity_servos,
    "friction loss": friction_loss,
    "joint limits": joint_limits,
    "equality constraints": equality,
    "tendons": tendons,
    "Euler": euler,
    "implicitfast": implicitfast,
    "implicit": implicit,
    "RK4": runge_kutta,
    "iterations=3, PGS": three_iterations,
    "default classes": default_classes,
    "inertia from geoms": inertia_from_geoms,
    "welded bodies": welded_bodies,
    "scenery": scenery,
    "tied to the world": tied_to_the_world,
    "gravcomp": weightless_arms,
    "actuatorgravcomp": compensated_arms,
}


def atlas_with(trait: str, folder: Path) -> Robot:
    """The walking humanoid with a trait, saved as a file and loaded from it."""
    folder.mkdir(parents=True, exist_ok=True)
    spec = atlas_spec()
    TRAITS[trait](spec, folder)
    path = folder / "robot.xml"
    if not path.exists():
        path.write_text(spec.to_xml())
    return Robot.load(path)


def suite_robot(name: str) -> Robot:
    """A robot of dm_control's suite as it is."""
    return Robot.load(SUITE / f"{name}.xml")


def stepping_humanoid() -> tuple[Robot, Robot]:
    """The suite's humanoid with five times its motors and a step of 1 ms, and the same as its walker takes it.

    The walker's legs begin at the floating base, which in this robot sits above the waist, so it takes the waist as
    locked; the waist's motors hold it.
    """
    spec = _stronger("humanoid", 5.0)
    robot = Robot(spec, "humanoid.xml")
    return robot, robot.locked({"abdomen_x": 0.0, "abdomen_y": 0.0, "abdomen_z": 0.0})


def _stronger(name: str, factor: float) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_file(str(SUITE / f"{name}.xml"))
    for actuator in spec.actuators:
        actuator.gear = np.array(actuator.gear) * factor
    spec.option.timestep = 0.001
    return spec
