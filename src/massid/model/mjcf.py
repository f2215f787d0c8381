"""The text of MJCF files: includes become part of it, bodies and joints get other numbers, the rest stays."""

from __future__ import annotations

from pathlib import Path

from massid.errors import ModelError
from massid.model.changes import NewBody, NewJoint
from massid.model.xml_text import Element, XmlText, numbers, tag

JOINT_ATTRIBUTES = {
    "dof_damping": "damping",
    "dof_frictionloss": "frictionloss",
    "dof_armature": "armature",
    "jnt_stiffness": "stiffness",
}
"""Field of MjModel -> attribute of <joint>."""
_ORIENTATIONS = ("euler", "axisangle", "xyaxes", "zaxis")
_DEEPEST = 50


def inlined(content: bytes, path: Path, depth: int = 0) -> bytes:
    """A file with its include files in it, as MuJoCo reads it.

    Args:
        content: of the file.
        path: of the main file, from which all include files are looked for.
        depth: of includes within includes.

    Raises:
        ModelError: an include file cannot be read.
    """
    text = XmlText(content, path.name)
    for element in text.root.all("include"):
        if element.parent is None:
            continue
        file = path.resolve().parent / element.attributes.get("file", "")
        try:
            inner = inlined(file.read_bytes(), path, depth + 1) if depth < _DEEPEST else b""
        except OSError as error:
            raise ModelError(f"{path.name}: include file {file} cannot be read: {error.strerror}.") from error
        included = XmlText(inner, file.name)
        text.replace(element, included.inside(included.root))
    return text.render()


def write_mjcf_body(text: XmlText, body: NewBody) -> bool:
    """Give a body its new inertia; False if the text has no such body, or several."""
    element = _only(text, "body", body.name)
    if element is None:
        return False
    inertial = element.child("inertial")
    if inertial is not None and body.growth is not None:
        scaled: dict[str, str | None] = {
            name: numbers(body.growth * float(value) for value in inertial.attributes[name].split())
            for name in ("diaginertia", "fullinertia")
            if name in inertial.attributes
        }
        if scaled:
            text.set(inertial, {"mass": repr(body.mass), **scaled})
            return True
    values = {
        "pos": numbers(body.centre),
        "quat": numbers(body.quaternion),
        "mass": repr(body.mass),
        "diaginertia": numbers(body.moments),
    }
    if inertial is None:
        text.insert_first(element, tag("inertial", values))
    else:
        text.set(inertial, {**values, **dict.fromkeys((*_ORIENTATIONS, "fullinertia"))})
    return True


def has_inertial(text: XmlText, body: str) -> bool:
    """Whether the text gives a body its inertia itself."""
    element = _only(text, "body", body)
    return element is not None and element.child("inertial") is not None


def write_mjcf_joint(text: XmlText, joint: NewJoint) -> bool:
    """Give a joint its new number; False if the text has no such joint, or several, or no place for it."""
    element, attribute = _only(text, "joint", joint.name), JOINT_ATTRIBUTES.get(joint.field)
    if element is None or attribute is None:
        return False
    others = element.attributes.get(attribute, "").split()[1:]  # terms of higher order stay
    text.set(element, {attribute: " ".join([repr(joint.value), *others])})
    return True


def _only(text: XmlText, kind: str, name: str) -> Element | None:
    """The one element of a name among bodies; joints of tendons are named likewise."""
    found = [
        one
        for one in text.root.all(kind)
        if one.attributes.get("name") == name and one.parent is not None and one.parent.tag not in ("default", "fixed")
    ]
    return found[0] if len(found) == 1 else None
