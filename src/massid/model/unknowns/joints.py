"""Unknowns of joints: dry friction and viscous damping; what points of Theta make of them."""

from __future__ import annotations

from collections.abc import Mapping

import mujoco
import numpy as np

from massid.search.parameters import Kind, Parameter, ParameterSpace
from massid.typing import FloatArray

FIELDS = {Kind.FRICTION: "dof_frictionloss", Kind.DAMPING: "dof_damping"}
TYPICAL_LEVER_M = 0.002
"""A typical friction torque is the robot's weight with this lever: 3 N m for 150 kg, 0.7 N m for 35 kg."""
TYPICAL_SPEED = 1.0
"""A typical damping makes that torque at this joint speed [rad/s]."""
REACH = 30.0
"""Theta ends at so many typical values above the model file's."""


def passive_parameter(model: mujoco.MjModel, kind: Kind, joint: str, weight_n: float) -> Parameter:
    """Friction loss or damping of a joint, from zero up."""
    nominal = float(getattr(model, FIELDS[kind])[model.joint(joint).dofadr[0]])
    typical = weight_n * TYPICAL_LEVER_M / (TYPICAL_SPEED if kind is Kind.DAMPING else 1.0)
    scale = max(nominal, typical)
    return Parameter(kind, joint, nominal, 0.0, nominal + REACH * scale, scale)


def joint_fields(model: mujoco.MjModel, space: ParameterSpace, points: FloatArray) -> Mapping[str, FloatArray]:
    """Model fields of N models, leading axis N; none where nothing is unknown."""
    fields: dict[str, FloatArray] = {}
    for parameter, values in zip(space.parameters, points.T, strict=True):
        if parameter.is_passive:
            name = FIELDS[parameter.kind]
            field = fields.setdefault(name, np.repeat(getattr(model, name)[None], len(points), axis=0))
            field[:, model.joint(parameter.target).dofadr[0]] = values
    return fields
