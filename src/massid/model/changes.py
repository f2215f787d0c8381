"""What a saved model has otherwise than its file: bodies, joints, and whatever only a spec can hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from massid.model.draft import Draft
from massid.model.edit import write_bodies
from massid.model.layout import Channels
from massid.model.unknowns.unknown import Unknown
from massid.typing import FloatArray


@dataclass(frozen=True)
class NewBody:
    """A body as it is to be saved.

    Attributes:
        name: of the body.
        mass: [kg].
        growth: factor on the file's rotational inertia if nothing else about it changes; None if more does.
        centre: centre of mass in the frame of the body, shape (3,) [m].
        moments: principal moments, shape (3,) [kg m^2].
        quaternion: attitude of their axes in the body, shape (4,).
    """

    name: str
    mass: float
    growth: float | None
    centre: FloatArray
    moments: FloatArray
    quaternion: FloatArray


@dataclass(frozen=True)
class NewJoint:
    """A number of a joint that is to be saved.

    Attributes:
        name: of the joint.
        field: of MjModel.
        value: the new one.
    """

    name: str
    field: str
    value: float


@dataclass(frozen=True)
class Changes:
    """What a saved model has otherwise than its file.

    Attributes:
        bodies: those that were identified.
        every_body: all bodies with a mass, for files whose compiler would not take masses as they are given.
        joints: numbers of joints; None if something else was changed, which only a spec can hold.
        write_spec: does all of that to a spec.
        expected: fields of MjModel that the saved file must give.
    """

    bodies: tuple[NewBody, ...]
    every_body: tuple[NewBody, ...]
    joints: tuple[NewJoint, ...] | None
    write_spec: Callable[[mujoco.MjSpec], None]
    expected: Mapping[str, FloatArray]


def changes_of(channels: Channels, unknowns: Sequence[Unknown], values: FloatArray) -> Changes:
    """What unknowns of a robot, none of them an error of a sensor, change in its model.

    Args:
        channels: of the robot.
        unknowns: what was found.
        values: of each, shape (n,).
    """
    model = channels.model
    draft = Draft(channels, unknowns, values[None])
    fields = draft.model_fields()
    numbers = {name: body.number for name, body in draft.bodies.items()}

    def write_spec(spec: mujoco.MjSpec) -> None:
        write_bodies(spec, model, list(numbers.values()), fields)
        for unknown, value in zip(unknowns, values.tolist(), strict=True):
            unknown.write_spec(spec, value)

    growth = {name: float(body.growth[0]) for name, body in draft.bodies.items() if body.keeps_frame}
    every = [b for b in range(1, model.nbody) if model.body_mass[b] > 0.0]
    return Changes(
        bodies=tuple(_new_body(model, fields, number, growth.get(name)) for name, number in numbers.items()),
        every_body=tuple(_new_body(model, fields, number, None) for number in every),
        joints=_new_joints(model, draft.fields_written),
        write_spec=write_spec,
        # Principal axes may come back in another order.
        expected={name: fields[name][0] for name in ("body_mass", *draft.fields_written)},
    )


def _new_body(model: mujoco.MjModel, fields: Mapping[str, FloatArray], number: int, growth: float | None) -> NewBody:
    """A body of the first of N models."""
    return NewBody(
        name=model.body(number).name,
        mass=float(fields["body_mass"][0, number]),
        growth=growth,
        centre=fields.get("body_ipos", model.body_ipos[None])[0, number],
        moments=fields["body_inertia"][0, number],
        quaternion=fields.get("body_iquat", model.body_iquat[None])[0, number],
    )


def _new_joints(model: mujoco.MjModel, fields: Mapping[str, FloatArray]) -> tuple[NewJoint, ...] | None:
    """Numbers of joints that the first of N models has otherwise; None if it has something else otherwise."""
    found = []
    for field, values in fields.items():
        for index in np.flatnonzero(values[0] != getattr(model, field)):
            if values.ndim != 2 or not field.startswith(("dof_", "jnt_")):
                return None
            joint = int(model.dof_jntid[index]) if field.startswith("dof_") else int(index)
            found.append(NewJoint(model.joint(joint).name, field, float(values[0, index])))
    return tuple(found)
