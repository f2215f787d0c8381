"""URDF files: read as robots that float, and given other masses, with the rest of their text kept.

MuJoCo reads URDF, but not all of it: the base has no free joint, links that are fixed to others lose their names,
meshes are looked for by their bare file names, and links without inertia get one from their shapes. What is read here
is a copy of the file in which all that is said; what could not be kept is said to the user.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

import mujoco
import numpy as np

from massid.errors import ModelError
from massid.typing import FloatArray

SUFFIX = ".urdf"
MESH_SUFFIXES = (".stl", ".obj", ".msh")
"""What MuJoCo reads."""
FREE_JOINT = "floating_base"
"""Name of the joint that a URDF does not have."""
LEAST_MASS_KG, LEAST_INERTIA = 1e-6, 1e-9
"""Of links that move but have no mass in the file: the engine takes nothing lighter."""
_FIXED, _FLOATING = "fixed", "floating"
_ONE_AXIS = ("revolute", "continuous", "prismatic")
_LEAST_RADIUS_M = 1e-3
"""Radius of gyration of a link that has mass and no inertia."""
_ROUNDED = 1e-6
PAIRS = ("xx", "xy", "xz", "yy", "yz", "zz")
INDICES = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_SHOWN = 4


def is_urdf(content: bytes) -> bool:
    """Whether a file is a URDF: its root is <robot>."""
    try:
        for _, element in ElementTree.iterparse(_Chunk(content), events=("start",)):
            return str(element.tag).rpartition("}")[2] == "robot"
    except ElementTree.ParseError:
        pass
    return False


class _Chunk:
    """Bytes as a file that is read once."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def read(self, _: int = -1) -> bytes:
        content, self._content = self._content, b""
        return content


def read_urdf(content: bytes, path: Path) -> tuple[mujoco.MjSpec, tuple[str, ...]]:
    """Read a URDF file as a spec with a floating base.

    Args:
        content: of the file.
        path: where it lies; meshes are looked for from there.

    Returns:
        The spec, and what was added to the file or left out of it, one line each.

    Raises:
        ModelError: it is no URDF of one robot, or a xacro file.
    """
    tree = _Tree(content, path)
    notes = tree.float_base()
    notes += tree.resolve_meshes()
    notes += tree.give_mass()
    notes += tree.mend_inertias()
    tree.set_compiler()
    try:
        spec = mujoco.MjSpec.from_string(tree.text())
    except (ValueError, mujoco.FatalError) as error:
        raise ModelError(f"{path}: not a model that MuJoCo can read: {' '.join(str(error).split())}") from error
    spec.modelfiledir = str(path.resolve().parent)
    base = spec.body(tree.base)
    if not base.joints:
        base.add_freejoint(name=tree.free_joint)
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # open and flat ones are not to be refused
    for body in spec.bodies:
        if not body.explicitinertial:  # nothing of it follows from shapes in a URDF
            for geom in body.geoms:
                geom.density, geom.mass = 0.0, 0.0
    notes.append(
        "a URDF says nothing of rotor inertias: in a log with noise they are estimated beside the masses, in one "
        "without ask for them joint by joint, `unknown=armature/JOINT`."
    )
    return spec, tuple(notes)


class _Tree:
    """A URDF that is being made ready for MuJoCo.

    Attributes:
        base: the link that floats.
        free_joint: name of its joint.
    """

    def __init__(self, content: bytes, path: Path) -> None:
        self._path = path
        try:
            self._root = ElementTree.fromstring(content)
        except ElementTree.ParseError as error:
            raise ModelError(f"{path}: not a model that can be read: {error}.") from error
        written = [value for part in ("link", "joint") for one in self._root.iter(part) for value in _values(one)]
        if any("xacro}" in str(one.tag) for one in self._root) or any("${" in value for value in written):
            raise ModelError(
                f"{path.name} is a xacro file, not yet a URDF: `xacro {path.name} > robot.urdf` makes one of it."
            )
        self._links = {_name(link): link for link in self._root.findall("link")}
        self._joints = {_end(joint, "child"): joint for joint in self._root.findall("joint")}
        if not self._links:
            raise ModelError(f"{path.name} is a URDF without links.")
        for link, joint in self._joints.items():
            for end in (link, _end(joint, "parent")):
                if end not in self._links:
                    raise ModelError(
                        f"{path.name}: joint '{_name(joint)}' is tied to link '{end}', which is not there."
                    )
        self.base = ""
        self.free_joint = FREE_JOINT

    def text(self) -> str:
        return ElementTree.tostring(self._root, encoding="unicode")

    def float_base(self) -> list[str]:
        """Find the link that floats and take out what is above it."""
        roots = [link for link in self._links if link not in self._joints]
        if len(roots) != 1:
            raise ModelError(
                f"{self._path.name} has {len(roots)} links without a parent ({', '.join(roots)}), not one."
            )
        floating = [link for link, joint in self._joints.items() if joint.get("type") == _FLOATING]
        if len(floating) > 1:
            raise ModelError(f"{self._path.name}: {len(floating)} links have floating joints ({', '.join(floating)}).")
        if floating:
            self.base = floating[0]
            self.free_joint = _name(self._joints[self.base])
            self._keep_only_below(self.base)
            return []
        base, held = roots[0], False
        while not _mass(self._links[base]):  # as a world that the robot is fixed to
            below = [link for link, joint in self._joints.items() if _end(joint, "parent") == base]
            heavy = [link for link in below if self._mass_below(link) > 0.0]
            if len(heavy) != 1 or (base != "world" and len(below) != 1) or self._type(heavy[0]) != _FIXED:
                break
            base, held = heavy[0], True
        self.base = base
        self._keep_only_below(base)
        above = " instead of being fixed" if held else ""
        return [f"the URDF has no floating joint: link '{base}' floats{above}."]

    def _type(self, link: str) -> str:
        return self._joints[link].get("type", "")

    def _mass_below(self, link: str) -> float:
        return sum(_mass(self._links[one]) for one in self._below(link))

    def _below(self, link: str) -> Iterator[str]:
        yield link
        for child, joint in self._joints.items():
            if _end(joint, "parent") == link:
                yield from self._below(child)

    def _keep_only_below(self, base: str) -> None:
        kept = set(self._below(base))
        for name in [name for name in self._links if name not in kept]:
            self._root.remove(self._links.pop(name))
        for child in [child for child in self._joints if child not in kept or child == base]:
            self._root.remove(self._joints.pop(child))

    def resolve_meshes(self) -> list[str]:
        """Say where meshes are; shapes whose mesh is not there, or of a kind that MuJoCo does not read, go."""
        compiler = self._root.find("mujoco/compiler")
        meshdir = "" if compiler is None else compiler.get("meshdir", "")
        seen: set[str] = set()
        touched: set[str] = set()
        for link in self._links.values():
            for shape in [*link.findall("visual"), *link.findall("collision")]:
                shape.attrib.pop("name", None)  # MuJoCo writes to the terminal about those that occur twice
                mesh = shape.find("geometry/mesh")
                if mesh is None:
                    continue
                name = mesh.get("filename", "")
                found = find_mesh(name, self._path, meshdir)
                if found is not None and found.suffix.lower() in MESH_SUFFIXES:
                    mesh.set("filename", str(found))
                    continue
                link.remove(shape)
                (seen if shape.tag == "visual" else touched).add(name)
        notes = []
        if seen:
            notes.append(f"{_counted(seen)} cannot be read and will not be drawn; a URDF weighs nothing by meshes.")
        if touched:
            notes.append(f"{_counted(touched)} cannot be read: contact between links that have them is not looked for.")
        return notes

    def give_mass(self) -> list[str]:
        """Let links without mass be as light as the engine allows if they move."""
        light = []
        for name, link in self._links.items():
            if _mass(link) or name == self.base or self._type(name) == _FIXED:
                continue
            for inertial in link.findall("inertial"):
                link.remove(inertial)
            if any(_mass(self._links[one]) for one in self._welded(name)):
                continue
            inertial = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(inertial, "mass", value=repr(LEAST_MASS_KG))
            moments = {axis: repr(LEAST_INERTIA) for axis in ("ixx", "iyy", "izz")}
            ElementTree.SubElement(inertial, "inertia", moments | dict.fromkeys(("ixy", "ixz", "iyz"), "0"))
            light.append(name)
        return [f"links that move but have no mass got 1 mg: {_listed(light)}."] if light else []

    def mend_inertias(self) -> list[str]:
        """Let inertias that no body can have be the nearest ones that a body can."""
        mended = []
        for name, link in self._links.items():
            inertia = link.find("inertial/inertia")
            if inertia is None or not _mass(link):
                continue
            try:
                given = [float(inertia.get(f"i{pair}", "0")) for pair in PAIRS]
            except ValueError as error:
                raise ModelError(f"{self._path.name}: the inertia of link '{name}' is not six numbers.") from error
            found = nearest_inertia(_matrix(given), _mass(link))
            if found is not None:
                mended.append(name)
                for (a, b), pair in zip(INDICES, PAIRS, strict=True):
                    inertia.set(f"i{pair}", repr(float(found[a, b])))
        return [f"no body has the inertia of {_listed(mended)}: the nearest possible one is taken."] if mended else []

    def _welded(self, link: str) -> Iterator[str]:
        """Links that move with another one, itself included."""
        yield link
        for child, joint in self._joints.items():
            if _end(joint, "parent") == link and joint.get("type") == _FIXED:
                yield from self._welded(child)

    def set_compiler(self) -> None:
        """Keep visual shapes, links that are fixed, and paths; what nothing moves mimics nothing."""
        extension = self._root.find("mujoco")
        if extension is None:
            extension = ElementTree.SubElement(self._root, "mujoco")
        compiler = extension.find("compiler")
        if compiler is None:
            compiler = ElementTree.SubElement(extension, "compiler")
        compiler.attrib.pop("meshdir", None)
        moving = {_name(joint) for joint in self._joints.values() if joint.get("type") in _ONE_AXIS}
        for joint in self._joints.values():
            for mimic in joint.findall("mimic"):
                if not {_name(joint), mimic.get("joint")} <= moving:
                    joint.remove(mimic)  # MuJoCo writes to the terminal about those
        for name in ("fusestatic", "discardvisual", "strippath"):
            compiler.set(name, "false")


def find_mesh(name: str, urdf: Path, meshdir: str = "") -> Path | None:
    """Where a mesh of a URDF is; None if it is nowhere.

    Args:
        name: as in the file: a path from there, file://PATH, package://PACKAGE/PATH or model://MODEL/PATH. Packages are
            looked for in the folders above the file and where ROS has them.
        urdf: the file.
        meshdir: folder of meshes, as MuJoCo's extension of URDF names it.
    """
    home = urdf.resolve().parent
    scheme, divider, rest = name.partition("://")
    if not divider:
        places = [home / meshdir / name, home / meshdir / Path(name).name, home / name]
    elif scheme == "file":
        places = [Path(unquote(rest))]
    else:
        package, _, inside = unquote(rest).partition("/")
        places = []
        for folder in (home, *home.parents):
            places.append(folder / package / inside)
            if folder.name == package:
                places.append(folder / inside)
        places += [root / package / inside for root in _ros_folders()]
        places += [folder / inside for folder in (home, *list(home.parents)[:2])]  # a package that was renamed
    return next((place for place in places if place.is_file()), None)


def nearest_inertia(inertia: FloatArray, mass: float) -> FloatArray | None:
    """The nearest inertia that a body of this mass can have, shape (3, 3); None if it is one.

    Principal moments are positive, and none is larger than the other two together.

    Args:
        inertia: shape (3, 3) [kg m^2].
        mass: [kg].
    """
    moments, axes = np.linalg.eigh(inertia)
    least = max(LEAST_INERTIA, _LEAST_RADIUS_M**2 * mass)
    excess = moments[2] - moments[0] - moments[1]
    if moments[0] > 0.0 and excess <= 0.0:
        return None
    possible = np.maximum(moments, least)
    excess = possible[2] - possible[0] - possible[1]
    if excess > 0.0:
        possible += (1.0 + _ROUNDED) / 3.0 * excess * np.array([1.0, 1.0, -1.0])
    return np.asarray(axes @ np.diag(possible) @ axes.T)


def _matrix(six: Sequence[float]) -> FloatArray:
    out = np.empty((3, 3))
    for (a, b), value in zip(INDICES, six, strict=True):
        out[a, b] = out[b, a] = value
    return out


def _ros_folders() -> list[Path]:
    """Folders that hold packages, as ROS 1 and ROS 2 have them in the environment."""
    first = [Path(one) for one in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if one]
    return first + [Path(one) / "share" for one in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if one]


def _values(element: ElementTree.Element) -> Iterator[str]:
    """Attributes of an element and of all in it."""
    for one in element.iter():
        yield from one.attrib.values()


def _name(element: ElementTree.Element) -> str:
    return element.get("name", "")


def _end(joint: ElementTree.Element, end: str) -> str:
    found = joint.find(end)
    return "" if found is None else found.get("link", "")


def _mass(link: ElementTree.Element) -> float:
    mass = link.find("inertial/mass")
    try:
        return 0.0 if mass is None else float(mass.get("value", "0"))
    except ValueError:
        return 0.0


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more


def _counted(meshes: set[str]) -> str:
    first = min(meshes)
    return f"mesh {first}" if len(meshes) == 1 else f"{len(meshes)} meshes ({first}, ...)"
