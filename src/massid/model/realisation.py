"""What parameter vectors mean for a model and its sensors, and how that gets into a compiled model or a spec."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from massid.model.unknowns.joints import FIELDS
from massid.search.parameters import Kind, ParameterSpace
from massid.typing import FloatArray


@dataclass(frozen=True)
class SensorErrors:
    """Slow errors of N models' sensors: reading(t) = (1 + gain) quantity(t - lag) + offset; every leading axis is N.

    Attributes:
        effort_offset: shape (N, n_joints) [N m].
        effort_gain: shape (N, n_joints).
        effort_lag: shape (N, 1) [s].
        wrench_offset: shape (N, 6 n_contacts) [N, N m].
        wrench_gain: shape (N, 6 n_contacts).
        wrench_lag: shape (N, 1) [s].
        encoder_offset: shape (N, n_joints) [rad].
    """

    effort_offset: FloatArray
    effort_gain: FloatArray
    effort_lag: FloatArray
    wrench_offset: FloatArray
    wrench_gain: FloatArray
    wrench_lag: FloatArray
    encoder_offset: FloatArray

    @classmethod
    def none(cls, n: int, n_joints: int, n_contacts: int) -> SensorErrors:
        """Perfect sensors."""
        per_joint, per_axis = (n, n_joints), (n, 6 * n_contacts)
        shapes = (per_joint, per_joint, (n, 1), per_axis, per_axis, (n, 1), per_joint)
        return cls(*(np.zeros(shape) for shape in shapes))


@dataclass(frozen=True)
class Realisation:
    """What N parameter vectors mean for N identification models; every leading axis is N.

    Attributes:
        model_fields: MjModel field name -> values, shape (N, *field shape).
        sensors: what the sensors do wrong; None for nothing.
        inertia_slopes: derivative of its body's pseudo-inertia by each parameter, at the first of the models and in the
            frame of the body, shape (n_p, 4, 4).
    """

    model_fields: Mapping[str, FloatArray]
    sensors: SensorErrors | None
    inertia_slopes: FloatArray

    @property
    def friction_loss(self) -> FloatArray | None:
        """Of every degree of freedom, shape (N, nv); None where it is the model file's."""
        return self.model_fields.get(FIELDS[Kind.FRICTION])

    def without_friction(self) -> Realisation:
        """The same for models whose friction loss is not the engine's concern."""
        kept = {name: values for name, values in self.model_fields.items() if name != FIELDS[Kind.FRICTION]}
        return replace(self, model_fields=kept)


def write_fields(model: mujoco.MjModel, realisation: Realisation, index: int = 0) -> None:
    """Write one row of a realisation into a compiled model and refresh what the engine derives from it."""
    for name, values in realisation.model_fields.items():
        getattr(model, name)[:] = values[index]
    mujoco.mj_setConst(model, mujoco.MjData(model))


def write_spec(
    spec: mujoco.MjSpec, model: mujoco.MjModel, space: ParameterSpace, fields: Mapping[str, FloatArray]
) -> None:
    """Write the first row of model fields into a spec, whether its inertia was given or came from geoms.

    Args:
        spec: changed: its compiler takes the bodies' inertia as it is given now.
        model: as compiled from it before.
        space: what can differ from the model.
        fields: MjModel field name -> values, shape (N, *field shape).
    """
    compiler = spec.compiler
    rescaled = compiler.settotalmass > 0 or compiler.boundmass > 0 or compiler.boundinertia > 0
    if rescaled or compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE:
        targets = list(range(1, model.nbody))
        compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO
        compiler.settotalmass, compiler.boundmass, compiler.boundinertia = -1.0, 0.0, 0.0
    else:
        targets = [model.body(p.body).id for p in space.parameters if p.is_inertial]
    ipos = fields.get("body_ipos", model.body_ipos[None])
    iquat = fields.get("body_iquat", model.body_iquat[None])
    for body_id in targets:
        name = model.body(body_id).name
        body = spec.body(name) if name else spec.bodies[body_id]
        body.explicitinertial = True
        body.mass = float(fields["body_mass"][0, body_id])
        body.ipos = ipos[0, body_id]
        body.iquat = iquat[0, body_id]
        body.inertia = fields["body_inertia"][0, body_id]
        body.fullinertia = np.full(6, np.nan)
    for parameter in space.parameters:
        if parameter.is_passive:
            joint = spec.joint(parameter.target)
            value = float(fields[FIELDS[parameter.kind]][0, model.joint(parameter.target).dofadr[0]])
            if parameter.kind is Kind.FRICTION:
                joint.frictionloss = value
            else:
                joint.damping = np.eye(len(joint.damping))[0] * value
