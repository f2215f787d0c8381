"""Where unknowns write their values: fields of N models, descriptions of their bodies, errors of their sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from massid.model.inertia import LOG_CHOLESKY, inertial_frame, log_cholesky_factor, pseudo_inertia, spread_of
from massid.model.layout import Channels
from massid.model.realisation import InertiaSlopes, Realisation, SensorErrors
from massid.model.unknowns.unknown import Unknown
from massid.typing import FloatArray, IntArray

_STEP = 1e-4
"""Difference for slopes, in scales; pseudo-inertias are smooth and no engine is asked."""


class BodyDraft:
    """One body of N models: its own mass, how that lies, and what it carries.

    A mass scales the rotational inertia of its body with it and leaves the centre of mass, as for a link whose density
    is uncertain. Inertia is that about the centre of mass, wherever it is; payloads come on top.

    Attributes:
        number: of the body in the model.
        mass: of the body itself, to be written to, shape (N,) [kg].
        gain: factor on the rotational inertia that a body of this mass has, to be written to, shape (N,).

    Args:
        model: with nominal bodies.
        name: of the body.
        n: number of models N.
    """

    def __init__(self, model: mujoco.MjModel, name: str, n: int) -> None:
        row = model.body(name)
        self.number = int(row.id)
        self._nominal_kg = float(row.mass[0])
        self.mass: FloatArray = np.full(n, self._nominal_kg)
        self.gain: FloatArray = np.ones(n)
        self._ipos = row.ipos.copy()
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, row.iquat)
        self._axes = rotation.reshape(3, 3)
        self._spread = spread_of(self._nominal_kg, row.inertia)
        self._centre: FloatArray | None = None
        self._shape: FloatArray | None = None
        self._payloads: list[tuple[FloatArray, FloatArray]] = []

    @property
    def centre(self) -> FloatArray:
        """Centre of mass in the frame of the body, to be written to, shape (N, 3) [m]."""
        if self._centre is None:
            self._centre = np.repeat(self._ipos[None], len(self.mass), axis=0)
        return self._centre

    @property
    def shape(self) -> FloatArray:
        """Log-Cholesky numbers of the rotational inertia, zero for the model file's; to be written to, shape (N, 6)."""
        if self._shape is None:
            self._shape = np.zeros((len(self.mass), len(LOG_CHOLESKY)))
        return self._shape

    def carry(self, mass: FloatArray, point: Sequence[float]) -> None:
        """Add a point mass, shape (N,) [kg], at a point in the frame of the body [m]."""
        self._payloads.append((mass, np.asarray(point, dtype=np.float64)))

    @property
    def keeps_frame(self) -> bool:
        """Whether its centre of mass and the shape of its inertia are the model file's."""
        return self._centre is None and self._shape is None and not self._payloads

    @property
    def keeps_shape(self) -> bool:
        """Whether the shape of its inertia is the model file's."""
        return self._shape is None

    @property
    def growth(self) -> FloatArray:
        """Factor on the model file's rotational inertia of a body that keeps its frame, shape (N,)."""
        return np.asarray(self.gain * self.mass / self._nominal_kg)

    def link(self, rows: slice | IntArray = slice(None)) -> FloatArray:
        """Pseudo-inertia of the body itself in some of the models, shape (n, 4, 4)."""
        mass = self.mass[rows]
        spread = np.broadcast_to(np.diag(self._spread), (len(mass), 3, 3))
        if self._shape is not None:
            scaled = np.sqrt(self._spread)[:, None] * log_cholesky_factor(self._shape[rows])
            spread = scaled @ scaled.transpose(0, 2, 1)
        spread = self.gain[rows][:, None, None] * (self._axes @ spread @ self._axes.T)
        centre = np.repeat(self._ipos[None], len(mass), axis=0) if self._centre is None else self._centre[rows]
        return pseudo_inertia(mass, centre, spread)

    def loaded(self, rows: slice | IntArray = slice(None)) -> FloatArray:
        """Pseudo-inertia of the body with its payloads in some of the models, shape (n, 4, 4)."""
        total = self.link(rows)
        for mass, point in self._payloads:
            at = np.repeat(point[None], len(total), axis=0)
            total = total + pseudo_inertia(mass[rows], at, np.zeros((3, 3)))
        return total


class Draft:
    """N models of a robot and their sensors, as its unknowns write them one after the other.

    Attributes:
        channels: of the robot with nominal values.
        bodies: those that were written to, by name.
        writers: for each of them the coordinates of the unknowns that wrote to it.

    Args:
        channels: of the robot with nominal values.
        unknowns: what each coordinate of a point means.
        points: shape (N, n_p).
    """

    def __init__(self, channels: Channels, unknowns: Sequence[Unknown], points: FloatArray) -> None:
        self.channels = channels
        self.bodies: dict[str, BodyDraft] = {}
        self.writers: dict[str, list[int]] = {}
        self._n = len(points)
        self._fields: dict[str, FloatArray] = {}
        self._sensors: SensorErrors | None = None
        for column, (unknown, values) in enumerate(zip(unknowns, points.T, strict=True)):
            self._writer = column
            unknown.write(self, values)

    def field(self, name: str) -> FloatArray:
        """A field of MjModel, to be written to, shape (N, *field shape); bodies are written by `body`."""
        if name not in self._fields:
            self._fields[name] = np.repeat(getattr(self.channels.model, name)[None], self._n, axis=0)
        return self._fields[name]

    def body(self, name: str) -> BodyDraft:
        """A body, to be written to."""
        if name not in self.bodies:
            self.bodies[name] = BodyDraft(self.channels.model, name, self._n)
        writers = self.writers.setdefault(name, [])
        if self._writer not in writers:
            writers.append(self._writer)
        return self.bodies[name]

    @property
    def sensors(self) -> SensorErrors:
        """Errors of the sensors, to be added to."""
        if self._sensors is None:
            self._sensors = SensorErrors.none(self._n, self.channels)
        return self._sensors

    @property
    def sensors_written(self) -> SensorErrors | None:
        """The same, None if nobody wrote to them."""
        return self._sensors

    @property
    def fields_written(self) -> Mapping[str, FloatArray]:
        """Fields of MjModel that were written to, those of bodies aside."""
        return self._fields

    def model_fields(self) -> dict[str, FloatArray]:
        """Everything for the models; frames of inertia only where they can differ from the nominal ones."""
        model = self.channels.model
        names = ["body_mass", "body_inertia"]
        if not all(body.keeps_frame for body in self.bodies.values()):
            names += ["body_ipos", "body_iquat"]
        fields = {name: np.repeat(getattr(model, name)[None], self._n, axis=0) for name in names}
        for body in self.bodies.values():
            number = body.number
            if body.keeps_frame:
                fields["body_inertia"][:, number] *= body.growth[:, None]
                fields["body_mass"][:, number] = body.mass
                continue
            frame = inertial_frame(body.loaded())
            fields["body_mass"][:, number], fields["body_inertia"][:, number] = frame.mass, frame.moments
            fields["body_ipos"][:, number], fields["body_iquat"][:, number] = frame.centre, frame.quaternion
        return {**fields, **self._fields}


def alone(channels: Channels, unknown: Unknown) -> Draft:
    """What one unknown writes at its nominal value."""
    return Draft(channels, (unknown,), np.array([[unknown.nominal]]))


def realise(channels: Channels, unknowns: Sequence[Unknown], points: FloatArray) -> Realisation:
    """Translate parameter vectors, shape (N, n_p), into model fields and errors of sensors."""
    draft = Draft(channels, unknowns, points)
    slopes = _inertia_slopes(draft, unknowns, points[0])
    return Realisation(draft.model_fields(), draft.sensors_written, slopes)


def _inertia_slopes(draft: Draft, unknowns: Sequence[Unknown], point: FloatArray) -> InertiaSlopes:
    """Derivatives of the bodies' pseudo-inertias by the unknowns that wrote to them."""
    columns = sorted({column for writers in draft.writers.values() for column in writers})
    place = {column: k for k, column in enumerate(columns)}
    own = [unknowns[column] for column in columns]
    step = _STEP * np.array([unknown.scale for unknown in own])
    offsets = np.diag(step)
    pair = Draft(draft.channels, own, point[columns] + np.vstack([offsets, -offsets]))
    numbers: list[int] = []
    slopes = [np.zeros((0, 4, 4))]
    for name, writers in draft.writers.items():
        rows = np.array([place[column] for column in writers], dtype=np.int64)
        body = pair.bodies[name]
        change = body.loaded(rows) - body.loaded(rows + len(columns))
        slopes.append(change / (2.0 * step[rows])[:, None, None])
        numbers += [body.number] * len(writers)
    return InertiaSlopes(
        unknowns=np.array([column for writers in draft.writers.values() for column in writers], dtype=np.int64),
        bodies=np.array(numbers, dtype=np.int64),
        pseudo_inertia=np.concatenate(slopes),
    )
