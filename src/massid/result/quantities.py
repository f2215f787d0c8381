"""What was found besides masses of links, as quantities that mean something: metres, kg m^2, kg of payload.

The six log-Cholesky numbers of an inertia are for the search; a user gets the principal moments that follow from them,
with deviations to first order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from massid.model.draft import Draft
from massid.model.inertia import inertial_frame
from massid.model.robot import Robot
from massid.model.unknowns.bodies import AXES, Inertia, Mass
from massid.model.unknowns.unknown import unknowns_of
from massid.result.document import QuantityEntry
from massid.result.posterior import interval_95
from massid.search.parameters import ParameterSpace
from massid.typing import BoolArray, FloatArray

_STEP = 1e-5
"""Difference for the derivative of moments, in scales."""


@dataclass(frozen=True)
class Quantity:
    """One number that was asked for besides the masses of links.

    Attributes:
        name: such as "com/torso/x".
        unit: of the values.
        nominal: of the model file.
        estimate: as found.
        std: standard deviation; None for a log without noise.
        identifiable: whether the log reveals it.
        parameters: names of the parameters that it follows from.
    """

    name: str
    unit: str
    nominal: float
    estimate: float
    std: float | None
    identifiable: bool
    parameters: tuple[str, ...]

    def without(self, hidden: Collection[str]) -> Quantity:
        """The quantity when some parameters turn out to be hidden."""
        return replace(self, identifiable=self.identifiable and not set(hidden) & set(self.parameters))

    def entry(self) -> QuantityEntry:
        """As a document holds it; without an estimate if the log does not reveal it."""
        std = self.std if self.identifiable else None
        return QuantityEntry(
            unit=self.unit,
            nominal=self.nominal,
            identifiable=self.identifiable,
            estimate=self.estimate if self.identifiable else None,
            std=std,
            interval95=interval_95(self.estimate, std),
        )


def describe(
    robot: Robot, space: ParameterSpace, estimate: FloatArray, covariance: FloatArray | None, identifiable: BoolArray
) -> tuple[Quantity, ...]:
    """Everything that was asked for but the masses of links.

    Args:
        robot: with nominal bodies.
        space: the parameters asked for.
        estimate: shape (n_p,).
        covariance: shape (n_p, n_p); None for a log without noise.
        identifiable: which parameters the log reveals, shape (n_p,).
    """
    found: list[Quantity] = []
    std = None if covariance is None else np.sqrt(np.diagonal(covariance))
    for k, parameter in enumerate(space.parameters):
        if isinstance(parameter, Mass | Inertia):
            continue
        name, value = parameter.name, float(estimate[k])
        own_std = None if std is None else float(std[k])
        found.append(Quantity(name, parameter.unit, parameter.nominal, value, own_std, bool(identifiable[k]), (name,)))
    for body in _shaped(space):
        columns = _shape_columns(space, body)
        found += _moments(robot, body, space, estimate, covariance, bool(identifiable[columns].all()))
    return tuple(found)


def whole_shapes(space: ParameterSpace, identifiable: BoolArray) -> BoolArray:
    """A rotational inertia is identifiable if all its numbers are: half of a shape is no shape."""
    out = identifiable.copy()
    for body in _shaped(space):
        columns = _shape_columns(space, body)
        out[columns] = out[columns].all()
    return out


def _shaped(space: ParameterSpace) -> list[str]:
    """The bodies whose rotational inertia was asked for."""
    return list(dict.fromkeys(parameter.body for parameter in space.parameters if isinstance(parameter, Inertia)))


def _shape_columns(space: ParameterSpace, body: str) -> list[int]:
    """Coordinates of a body's rotational inertia."""
    return [k for k, p in enumerate(space.parameters) if isinstance(p, Inertia) and p.body == body]


def _moments(
    robot: Robot,
    body: str,
    space: ParameterSpace,
    estimate: FloatArray,
    covariance: FloatArray | None,
    identifiable: bool,
) -> list[Quantity]:
    """Principal moments of a link about its centre of mass, smallest first; payloads do not belong to it."""
    in_model = {k: unknown for k, unknown in enumerate(unknowns_of(space)) if not unknown.per_walk}

    def moments(points: FloatArray) -> FloatArray:
        draft = Draft(robot.channels(), tuple(in_model.values()), points[:, list(in_model)])
        return np.sort(inertial_frame(draft.bodies[body].link()).moments, axis=1)

    nominal, value = moments(np.vstack([space.nominal, estimate]))
    std: Sequence[float | None] = [None] * len(AXES)
    if covariance is not None:
        slope = _slope(moments, estimate, space.scale)
        std = np.sqrt(np.diagonal(slope @ covariance @ slope.T)).tolist()
    names = tuple(space.parameters[k].name for k in _shape_columns(space, body))
    rows = zip(nominal.tolist(), value.tolist(), std, strict=True)
    return [
        Quantity(f"{Inertia.kind}/{body}/{number}", "kg m^2", before, after, deviation, identifiable, names)
        for number, (before, after, deviation) in enumerate(rows, start=1)
    ]


def _slope(of: Callable[[FloatArray], FloatArray], point: FloatArray, scale: FloatArray) -> FloatArray:
    """Derivative of a function of points by their coordinates, shape (n_values, n_p)."""
    step = np.diag(_STEP * scale)
    return np.asarray(((of(point + step) - of(point - step)) / (2.0 * _STEP * scale)[:, None]).T)
