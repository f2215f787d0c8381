"""What parameter vectors mean for a model and its sensors, and how that gets into a compiled model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from massid.model.layout import Channels
from massid.typing import FloatArray, IntArray

FRICTION_LOSS = "dof_frictionloss"
"""Model field that an observer may take out of the engine's hands."""


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
        state_offset: of the measured state, positions then velocities in the tangent space, shape (N, 2 nv).
    """

    effort_offset: FloatArray
    effort_gain: FloatArray
    effort_lag: FloatArray
    wrench_offset: FloatArray
    wrench_gain: FloatArray
    wrench_lag: FloatArray
    state_offset: FloatArray

    @classmethod
    def none(cls, n: int, channels: Channels) -> SensorErrors:
        """Perfect sensors."""
        per_joint, per_axis = (n, len(channels.joint_names)), (n, 6 * len(channels.contact_bodies))
        shapes = (per_joint, per_joint, (n, 1), per_axis, per_axis, (n, 1), (n, 2 * channels.model.nv))
        return cls(*(np.zeros(shape) for shape in shapes))


@dataclass(frozen=True)
class InertiaSlopes:
    """How bodies change with the unknowns, at one point: a row for each body that each of them changes.

    Attributes:
        unknowns: coordinate of the unknown, shape (n,).
        bodies: number of the body, shape (n,).
        pseudo_inertia: derivative of the body's pseudo-inertia in its own frame, shape (n, 4, 4).
    """

    unknowns: IntArray
    bodies: IntArray
    pseudo_inertia: FloatArray


@dataclass(frozen=True)
class Realisation:
    """What N parameter vectors mean for N identification models; every leading axis is N.

    Attributes:
        model_fields: MjModel field name -> values, shape (N, *field shape).
        sensors: what the sensors do wrong; None for nothing.
        inertia_slopes: how bodies change, at the first of the models.
    """

    model_fields: Mapping[str, FloatArray]
    sensors: SensorErrors | None
    inertia_slopes: InertiaSlopes

    @property
    def friction_loss(self) -> FloatArray | None:
        """Of every degree of freedom, shape (N, nv); None where it is the model file's."""
        return self.model_fields.get(FRICTION_LOSS)

    def without_friction(self) -> Realisation:
        """The same for models whose friction loss is not the engine's concern."""
        kept = {name: values for name, values in self.model_fields.items() if name != FRICTION_LOSS}
        return replace(self, model_fields=kept)


def write_fields(model: mujoco.MjModel, realisation: Realisation, index: int = 0) -> None:
    """Write one row of a realisation into a compiled model and refresh what the engine derives from it."""
    for name, values in realisation.model_fields.items():
        getattr(model, name)[:] = values[index]
    mujoco.mj_setConst(model, mujoco.MjData(model))
