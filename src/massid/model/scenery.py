"""A model file holds more than a robot: other things that move, ties to them and to the world, files that are gone.

What is not the robot is held still or left out of its model, and the user is told. The file itself, and what is saved,
keeps it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

import mujoco

from massid.errors import ModelError

_FREE = mujoco.mjtJoint.mjJNT_FREE
_BALL = mujoco.mjtJoint.mjJNT_BALL
_SHOWN = 4


def name_bodies(spec: mujoco.MjSpec, base: str) -> list[str]:
    """Name bodies that have no name, so that they can be weighed and spoken of.

    Args:
        spec: changed.
        base: name of the robot's floating base.

    Returns:
        Which names bodies of the robot got, in a line; none if none did.
    """
    taken = {body.name for body in spec.bodies}
    named: list[str] = []
    for body in spec.bodies:
        if body.name:
            continue
        stem = next((joint.name for joint in body.joints if joint.name), f"{body.parent.name}_part")
        name, number = f"{stem}_body", 1
        while name in taken:
            number += 1
            name = f"{stem}_body{number}"
        body.name = name
        taken.add(name)
        named.append(name)
    robot = {body.name for body in _tree(spec.body(base))}
    named = [name for name in named if name in robot]
    return [f"bodies without a name are called by their joints or parents: {_listed(named)}."] if named else []


def find_base(spec: mujoco.MjSpec, source: str) -> mujoco.MjsBody:
    """The floating base: the body with a free joint that has the most joints below it.

    Args:
        spec: any.
        source: name of the file, for messages.

    Raises:
        ModelError: nothing floats, or it cannot be told which of several is the robot.
    """
    floating = [body for body in spec.bodies if any(joint.type == _FREE for joint in body.joints)]
    if not floating:
        raise ModelError(f"{source}: {_no_base(spec)}")
    counts = [len(body.find_all("joint")) for body in floating]
    most = max(counts)
    best = [body for body, count in zip(floating, counts, strict=True) if count == most]
    if len(best) > 1:
        names = ", ".join(body.name or "one without a name" for body in best)
        raise ModelError(
            f"{source}: expected one body with a free joint (the floating base), found {len(best)} ({names}). Take the "
            f"others out of the file: all have {most - 1} joints, so which is the robot cannot be told."
        )
    return best[0]


def _no_base(spec: mujoco.MjSpec) -> str:
    """What to do about a robot that does not float."""
    text = "expected one body with a free joint (the floating base), found 0 (none)."
    roots = list(spec.worldbody.bodies)
    if not roots:
        return text
    base = max(roots, key=lambda body: len(body.find_all("joint")))
    while not base.joints and len(base.bodies) == 1 and not _has_mass(base):
        base = base.bodies[0]
    name = base.name or "without a name"
    if len(base.joints) < 2 and not any(joint.type == _BALL for joint in base.joints):
        return f"{text} Add <freejoint/> to body '{name}'."
    listed = ", ".join(joint.name or "one without a name" for joint in base.joints)
    return (
        f"{text} The joints of body '{name}' ({listed}) are its base's: put <freejoint/> in their place. A log gives "
        "the base a pose and a twist, whatever it is held by."
    )


def _has_mass(body: mujoco.MjsBody) -> bool:
    return bool(body.explicitinertial or body.geoms)


def hold_scenery(spec: mujoco.MjSpec, base: str) -> list[str]:
    """Hold everything still that is not the robot, and cut what ties the robot to it.

    Args:
        spec: changed; its bodies have names.
        base: name of the robot's floating base.

    Returns:
        What was done, one line each.
    """
    robot = {body.name for body in _tree(spec.body(base))}
    notes, gone = [], []
    held = [body for body in spec.bodies if body.joints and body.name not in robot]
    for flex in list(spec.flexes):
        spec.delete(flex)
    for body in held:
        gone += [joint.name for joint in body.joints if joint.name]
    if held:
        names = list(dict.fromkeys(_root(body).name for body in held))
        notes.append(f"{_listed(names)} can move but {'is' if len(names) == 1 else 'are'} not the robot: held still.")
        notes += drop_references(spec, set(gone))
    for body in held:
        for joint in list(body.joints):
            spec.delete(joint)
    return notes + _untie(spec, robot)


def _untie(spec: mujoco.MjSpec, robot: set[str]) -> list[str]:
    """Take out active welds and connects between the robot and what is not the robot: they would bear its weight."""
    homes = {site.name: body.name for body in spec.bodies for site in body.sites}
    notes = []
    for equality in list(spec.equalities):
        if equality.type not in (mujoco.mjtEq.mjEQ_WELD, mujoco.mjtEq.mjEQ_CONNECT):
            continue
        at_sites = equality.objtype == mujoco.mjtObj.mjOBJ_SITE
        ends = [homes.get(name, "") if at_sites else name for name in (equality.name1, equality.name2)]
        ours = [end for end in ends if end in robot]
        if len(ours) == len(ends):
            continue
        if ours and equality.active:
            kind = "weld" if equality.type == mujoco.mjtEq.mjEQ_WELD else "connect"
            name = f" '{equality.name}'" if equality.name else ""
            other = next(end for end in ends if end not in robot) or "world"
            notes.append(
                f"{kind}{name} ties {ours[0]} to {other}: left out. If it held the robot during the log, its wrench is "
                f"a contact of {ours[0]} that must be logged."
            )
        spec.delete(equality)
    return notes


def drop_references(spec: mujoco.MjSpec, joints: set[str]) -> list[str]:
    """Take out what refers to joints that are about to go: actuators, equalities, tendons; keyframes, sensors, tuples.

    Args:
        spec: changed.
        joints: their names.

    Returns:
        What tied a joint that stays to one that goes, in a line each.
    """
    notes = []
    for group in (spec.keys, spec.sensors, spec.tuples):
        for element in list(group):
            spec.delete(element)
    tendons = set()
    for tendon in list(spec.tendons):
        wraps = [wrap.target.name for wrap in tendon.path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT]
        if joints & set(wraps):
            tendons.add(tendon.name)
            if set(wraps) - joints:
                notes.append(f"tendon '{tendon.name}' ties {_listed(wraps)}, not all of which move: left out.")
            spec.delete(tendon)
    transmissions = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)
    for actuator in list(spec.actuators):
        on_joint = actuator.trntype in transmissions and actuator.target in joints
        if on_joint or (actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON and actuator.target in tendons):
            spec.delete(actuator)
    for equality in list(spec.equalities):
        names = {equality.name1, equality.name2} - {""}
        known = {mujoco.mjtEq.mjEQ_JOINT: joints, mujoco.mjtEq.mjEQ_TENDON: tendons}.get(equality.type, set())
        if names & known:
            if names - known:
                notes.append(
                    f"equality '{equality.name}' ties {_listed(sorted(names))}, not all of which move: left out."
                )
            spec.delete(equality)
    return notes


def without_lost_meshes(spec: mujoco.MjSpec, source: str) -> tuple[mujoco.MjSpec, list[str]]:
    """Return a copy of a spec without meshes and height fields that cannot be read, where no mass follows from them.

    Args:
        spec: that does not compile.
        source: name of the file, for messages.

    Returns:
        The copy, and what was left out, in a line; the copy may still not compile.

    Raises:
        ModelError: a mass follows from one of them.
    """
    spec, lost, touched = spec.copy(), list[str](), False
    for _ in range(1 + len(spec.meshes) + len(spec.hfields)):
        try:
            spec.copy().compile()
            break
        except ValueError as error:
            said = str(error)
        gone = _unreadable(spec, said)
        weighed = [body for body in (_weighs(spec, name) for name in gone) if body]
        if weighed:
            raise ModelError(
                f"{source}: {' '.join(said.split())}; the mass of {weighed[0]} follows from it: put the file there, or "
                "give that body an <inertial>."
            )
        if not gone:
            break
        for body in spec.bodies:
            for geom in list(body.geoms):
                if geom.meshname in gone or geom.hfieldname in gone:
                    touched = touched or bool(geom.contype or geom.conaffinity)
                    spec.delete(geom)
        for element in [*spec.meshes, *spec.hfields]:
            if element.name in gone or Path(element.file).stem in gone:
                spec.delete(element)
        lost += gone
    if not lost:
        return spec, []
    them = "it" if len(lost) == 1 else "them"
    contact = f", and contact with {them} is not looked for" if touched else ""
    return spec, [
        f"mesh{'' if len(lost) == 1 else 'es'} {_listed(lost)} cannot be read: left out, as no mass follows from "
        f"{them}{contact}."
    ]


def _unreadable(spec: mujoco.MjSpec, error: str) -> list[str]:
    """Names of meshes and height fields whose file is not there; or of the one that the engine complains about."""
    files = [*spec.meshes, *spec.hfields]
    gone = []
    for element in files:
        path = Path(spec.modelfiledir) / element.compiler.meshdir / element.file
        if element.file and element.file not in spec.assets and not path.is_file() and path.name in error:
            gone.append(element.name or Path(element.file).stem)
    named = re.search(r"Element name '([^']*)'", error)
    if not gone and named:
        gone = [element.name for element in files if element.file and element.name == named[1]]
    return gone


def _weighs(spec: mujoco.MjSpec, mesh: str) -> str | None:
    """The body whose mass follows from a mesh; None for none."""
    for body in spec.bodies:
        from_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        if body.name == "world" or (body.explicitinertial and not from_geoms):
            continue
        for geom in body.geoms:
            low, high = spec.compiler.inertiagrouprange
            given = geom.mass if geom.mass == geom.mass else geom.density
            if geom.meshname == mesh and low <= geom.group <= high and given > 0.0:
                return str(body.name)
    return None


def _tree(body: mujoco.MjsBody) -> Iterable[mujoco.MjsBody]:
    yield body
    for child in body.bodies:
        yield from _tree(child)


def _root(body: mujoco.MjsBody) -> mujoco.MjsBody:
    while body.parent is not None and body.parent.name != "world":
        body = body.parent
    return body


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
