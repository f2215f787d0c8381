"""Unknowns of rigid bodies: mass, centre of mass, rotational inertia, payload; what points of Theta make of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from massid.errors import BadInputError, ModelError
from massid.model.inertia import (
    LOG_CHOLESKY,
    inertial_frame,
    log_cholesky_factor,
    pseudo_inertia,
    spread_of,
)
from massid.search.parameters import Kind, Parameter, ParameterSpace
from massid.typing import FloatArray

AXES = ("x", "y", "z")
CENTRE_REACH = 4.0
"""Theta of a centre of mass, in radii of gyration to either side of the model file's."""
SMALLEST_REACH_M = 0.01
"""Taken for the radius of gyration of a body that is next to a point."""
SHAPE_SCALE, SHAPE_REACH = 0.5, 1.5
"""Typical change and bound of the logarithm of a radius of gyration: a factor of 4.5 to either side."""
FARTHEST_PAYLOAD = 3.0
"""Times the size of the robot."""
PAYLOAD_REACH = 0.5
"""Largest payload, as a share of the whole robot's mass."""
SMALLEST_PAYLOAD_SCALE = 0.01
"""Typical payload of a link that weighs next to nothing, as a share of the whole robot's mass."""
_FLAT = 1e-9
"""Smallest square of a radius of gyration, relative to the largest, of a body that has three extents."""
_STEP = 1e-4
"""Difference for slopes, in scales; pseudo-inertias are smooth and no engine is asked."""


def centre_parameters(model: mujoco.MjModel, link: str) -> list[Parameter]:
    """Centre of mass of a link in the frame of its body [m], one parameter an axis."""
    body = model.body(link)
    spread = spread_of(float(body.mass[0]), body.inertia)
    radius = max(float(np.sqrt(max(spread.sum(), 0.0) / 3.0)), SMALLEST_REACH_M)
    reach = CENTRE_REACH * radius
    return [
        Parameter(Kind.COM, f"{link}/{axis}", nominal, nominal - reach, nominal + reach, radius)
        for axis, nominal in zip(AXES, body.ipos.tolist(), strict=True)
    ]


def inertia_parameters(model: mujoco.MjModel, link: str) -> list[Parameter]:
    """Rotational inertia of a link about its centre of mass: six numbers that are zero for the model file.

    Raises:
        ModelError: the model file's inertia is that of a body without thickness, from which no thickness can be scaled.
    """
    body = model.body(link)
    spread = spread_of(float(body.mass[0]), body.inertia)
    if spread.min() <= _FLAT * spread.max():
        moments = ", ".join(f"{moment:.4g}" for moment in body.inertia)
        raise ModelError(
            f"Body '{link}' has principal moments {moments} kg m^2, those of a body without thickness: its inertia "
            "cannot be identified; give the model a physical one (each moment less than the sum of the other two)."
        )
    return [
        Parameter(Kind.INERTIA, f"{link}/{entry}", 0.0, -SHAPE_REACH, SHAPE_REACH, SHAPE_SCALE)
        for entry in LOG_CHOLESKY
    ]


def payload_parameter(model: mujoco.MjModel, text: str, total_kg: float) -> Parameter:
    """A point mass on a body, written BODY or BODY@X,Y,Z in the frame of the body [m]; nominally none.

    Raises:
        BadInputError: the point is not three finite numbers, or nowhere near the robot.
    """
    body, point = parse_payload(text)
    away_m, size_m = float(np.linalg.norm(point)), float(model.stat.extent)
    if away_m > FARTHEST_PAYLOAD * size_m:
        raise BadInputError(
            f"Payload '{text}' is {away_m:.3g} m from the origin of {body}; expected a point on the robot, which is "
            f"{size_m:.2g} m across, in metres and in the frame of the body."
        )
    scale = max(float(model.body(body).mass[0]), SMALLEST_PAYLOAD_SCALE * total_kg)
    upper = max(PAYLOAD_REACH * total_kg, scale)
    return Parameter(Kind.PAYLOAD, f"{body}@{','.join(f'{x:g}' for x in point)}", 0.0, 0.0, upper, scale)


def parse_payload(text: str) -> tuple[str, FloatArray]:
    """Body and point of BODY@X,Y,Z; without a point it is the origin of the body's frame.

    Raises:
        BadInputError: the point is not three finite numbers.
    """
    body, at, numbers = text.rpartition("@")
    if not at:
        return text, np.zeros(3)
    try:
        point = np.array([float(number) for number in numbers.split(",")])
    except ValueError:
        point = np.empty(0)
    if point.shape != (3,) or not np.all(np.isfinite(point)):
        raise BadInputError(
            f"Payload '{text}': expected BODY or BODY@X,Y,Z with a point in metres, such as hand@0,0,0.1."
        )
    return body, point


class BodyUnknowns:
    """What is unknown of one body.

    Args:
        model: with nominal bodies.
        body: its name.
        space: all unknowns.
    """

    def __init__(self, model: mujoco.MjModel, body: str, space: ParameterSpace) -> None:
        self.body = body
        self._nominal = space.nominal
        own = [(k, p) for k, p in enumerate(space.parameters) if p.is_inertial and p.body == body]
        self.columns = tuple(k for k, _ in own)
        self._mass = [k for k, p in own if p.kind is Kind.MASS]
        self._centre = {AXES.index(p.entry): k for k, p in own if p.kind is Kind.COM}
        self._scale = [k for k, p in own if p.kind is Kind.INERTIA_SCALE]
        self._shape = {LOG_CHOLESKY.index(p.entry): k for k, p in own if p.kind is Kind.INERTIA}
        self._payloads = [(k, parse_payload(p.target)[1]) for k, p in own if p.kind is Kind.PAYLOAD]
        row = model.body(body)
        self._mass_kg, self._ipos = float(row.mass[0]), row.ipos.copy()
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, row.iquat)
        self._axes = rotation.reshape(3, 3)
        self._spread = spread_of(self._mass_kg, row.inertia)

    @property
    def keeps_frame(self) -> bool:
        """Whether its centre of mass and the shape of its inertia are the model file's."""
        return len(self.columns) == len(self._mass) + len(self._scale)

    def mass(self, points: FloatArray) -> FloatArray:
        """Mass of the body itself, shape (N,) [kg]."""
        return points[:, self._mass[0]] if self._mass else np.full(len(points), self._mass_kg)

    def gain(self, points: FloatArray) -> FloatArray:
        """Factor on the rotational inertia that a body of this mass has in the model file, shape (N,)."""
        return np.exp(points[:, self._scale[0]]) if self._scale else np.ones(len(points))

    def link(self, points: FloatArray) -> FloatArray:
        """Pseudo-inertia of the body itself, shape (N, 4, 4)."""
        n = len(points)
        centre = np.repeat(self._ipos[None], n, axis=0)
        for axis, column in self._centre.items():
            centre[:, axis] = points[:, column]
        spread = np.broadcast_to(np.diag(self._spread), (n, 3, 3))
        if self._shape:
            entries = np.zeros((n, len(LOG_CHOLESKY)))
            for entry, column in self._shape.items():
                entries[:, entry] = points[:, column]
            scaled = np.sqrt(self._spread)[:, None] * log_cholesky_factor(entries)
            spread = scaled @ scaled.transpose(0, 2, 1)
        spread = self.gain(points)[:, None, None] * (self._axes @ spread @ self._axes.T)
        return pseudo_inertia(self.mass(points), centre, spread)

    def loaded(self, points: FloatArray) -> FloatArray:
        """Pseudo-inertia of the body with its payloads, shape (N, 4, 4)."""
        total = self.link(points)
        for column, point in self._payloads:
            at = np.repeat(point[None], len(points), axis=0)
            total = total + pseudo_inertia(points[:, column], at, np.zeros((3, 3)))
        return total

    def slopes(self, point: FloatArray, scale: FloatArray) -> FloatArray:
        """Derivatives of the pseudo-inertia by this body's parameters, shape (n_columns, 4, 4)."""
        step = _STEP * scale[list(self.columns)]
        offsets = np.zeros((len(step), len(point)))
        offsets[np.arange(len(step)), list(self.columns)] = step
        change = self.loaded(point + offsets) - self.loaded(point - offsets)
        return np.asarray(change / (2.0 * step)[:, None, None])


def unknown_bodies(model: mujoco.MjModel, space: ParameterSpace) -> list[BodyUnknowns]:
    """Every body of which something is unknown."""
    names = dict.fromkeys(p.body for p in space.parameters if p.is_inertial)
    return [BodyUnknowns(model, name, space) for name in names]


def body_fields(model: mujoco.MjModel, bodies: Sequence[BodyUnknowns], points: FloatArray) -> Mapping[str, FloatArray]:
    """Model fields of N models, leading axis N; frames of inertia only where they can differ from the nominal ones."""
    names = ["body_mass", "body_inertia"]
    if not all(body.keeps_frame for body in bodies):
        names += ["body_ipos", "body_iquat"]
    fields = {name: np.repeat(getattr(model, name)[None], len(points), axis=0) for name in names}
    for body in bodies:
        number = model.body(body.body).id
        if body.keeps_frame:
            mass = body.mass(points)
            fields["body_inertia"][:, number] *= (body.gain(points) * mass / model.body_mass[number])[:, None]
            fields["body_mass"][:, number] = mass
            continue
        frame = inertial_frame(body.loaded(points))
        fields["body_mass"][:, number], fields["body_inertia"][:, number] = frame.mass, frame.moments
        fields["body_ipos"][:, number], fields["body_iquat"][:, number] = frame.centre, frame.quaternion
    return fields


def inertia_slopes(bodies: Sequence[BodyUnknowns], space: ParameterSpace, point: FloatArray) -> FloatArray:
    """Derivative of its body's pseudo-inertia by each parameter, zero for others, shape (n_p, 4, 4)."""
    out = np.zeros((len(space), 4, 4))
    for body in bodies:
        out[list(body.columns)] = body.slopes(point, space.scale)
    return out
