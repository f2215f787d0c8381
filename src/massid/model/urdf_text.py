"""The text of URDF files: links and joints get other numbers, the rest stays."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from massid.model.changes import NewBody, NewJoint
from massid.model.urdf import INDICES, PAIRS
from massid.model.xml_text import Element, XmlText, numbers
from massid.typing import FloatArray

JOINT_ATTRIBUTES: Mapping[str, str] = {"dof_damping": "damping", "dof_frictionloss": "friction"}
"""What a URDF says of a joint besides where it is: field of MjModel -> attribute of <dynamics>."""


def write_urdf_body(text: XmlText, body: NewBody) -> bool:
    """Give a link its new inertia; False if the text has no such link."""
    element = _named(text, "link", body.name)
    if element is None:
        return False
    inertial = element.child("inertial")
    mass, inertia = (None, None) if inertial is None else (inertial.child("mass"), inertial.child("inertia"))
    if mass is not None and inertia is not None and body.growth is not None:
        text.set(mass, {"value": repr(body.mass)})
        text.set(inertia, {name: repr(body.growth * float(value)) for name, value in inertia.attributes.items()})
        return True
    full = _in_body(body)
    moments = " ".join(f'i{pair}="{float(full[at])!r}"' for at, pair in zip(INDICES, PAIRS, strict=True))
    written = (
        f'<inertial><origin xyz="{numbers(body.centre)}" rpy="0 0 0"/><mass value="{body.mass!r}"/>'
        f"<inertia {moments}/></inertial>"
    )
    if inertial is None:
        text.insert_first(element, written)
    else:
        text.replace(inertial, written)
    return True


def write_urdf_joint(text: XmlText, joint: NewJoint) -> bool:
    """Give a joint its new number; False if the text has no such joint, or no place for it."""
    element, attribute = _named(text, "joint", joint.name), JOINT_ATTRIBUTES.get(joint.field)
    if element is None or attribute is None:
        return False
    dynamics = element.child("dynamics")
    if dynamics is None:
        text.insert_first(element, f'<dynamics {attribute}="{joint.value!r}"/>')
    else:
        text.set(dynamics, {attribute: repr(joint.value)})
    return True


def _named(text: XmlText, tag: str, name: str) -> Element | None:
    """The link or joint of a name."""
    return next((one for one in text.root.children if one.tag == tag and one.attributes.get("name") == name), None)


def _in_body(body: NewBody) -> FloatArray:
    """Inertia about the centre of mass in the frame of the body, shape (3, 3) [kg m^2]."""
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, body.quaternion)
    axes = rotation.reshape(3, 3)
    return np.asarray(axes @ np.diag(body.moments) @ axes.T)
