"""What is unknown: parameters with units, bounds and priors, and the space Theta that they span (Section II-B)."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from massid.errors import BadInputError
from massid.typing import FloatArray

THETA_LOWER, THETA_UPPER = 0.3, 2.5
"""Default bounds of a mass, as multiples of its nominal value."""


class Kind(enum.StrEnum):
    """How a parameter acts on an identification model."""

    MASS = "mass"
    """Mass of a link; its rotational inertia scales with it, its centre of mass stays."""
    EFFORT_OFFSET = "effort_offset"
    """Constant error of a joint's torque sensor."""
    COEFFICIENT = "coefficient"
    """A number in the right-hand side of a system of one's own, without a unit; robots have none."""


UNITS = {Kind.MASS: "kg", Kind.EFFORT_OFFSET: "N m", Kind.COEFFICIENT: "1"}


@dataclass(frozen=True)
class Parameter:
    """One unknown quantity.

    Attributes:
        kind: how it acts.
        target: the link or joint it belongs to.
        nominal: the value of the model file, in `unit`.
        lower: lower bound of Theta.
        upper: upper bound of Theta.
        scale: a typical change, in `unit`: samples spread by fractions of it.
        prior_std: standard deviation of the belief before the log is seen; None for no belief.
        requested: whether the user asked for it; the others are nuisances, estimated but not reported first.
    """

    kind: Kind
    target: str
    nominal: float
    lower: float
    upper: float
    scale: float
    prior_std: float | None = None
    requested: bool = True

    def __post_init__(self) -> None:
        if not (self.lower < self.upper and self.lower <= self.nominal <= self.upper):
            raise BadInputError(
                f"{self.name}: nominal {self.nominal} {self.unit} must lie in [{self.lower}, {self.upper}]."
            )
        if not self.scale > 0:
            raise BadInputError(f"{self.name}: scale {self.scale} must be positive.")

    @property
    def name(self) -> str:
        """Unique name such as "mass/l_thigh"."""
        return f"{self.kind}/{self.target}"

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        return UNITS[self.kind]

    @classmethod
    def mass(cls, link: str, nominal_kg: float) -> Parameter:
        """Mass of a link, within the default Theta."""
        return cls(
            kind=Kind.MASS,
            target=link,
            nominal=nominal_kg,
            lower=THETA_LOWER * nominal_kg,
            upper=THETA_UPPER * nominal_kg,
            scale=nominal_kg,
        )


@dataclass(frozen=True)
class ParameterSpace:
    """An ordered set of parameters: the box Theta, and the meaning of each coordinate of a point p."""

    parameters: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        names = self.names
        repeated = sorted({name for name in names if names.count(name) > 1})
        if not names:
            raise BadInputError("No parameter to identify: name at least one link.")
        if repeated:
            raise BadInputError(f"Parameters named more than once: {', '.join(repeated)}.")

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Unique name of each coordinate."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def nominal(self) -> FloatArray:
        """The model file's values, shape (n_p,)."""
        return np.array([parameter.nominal for parameter in self.parameters])

    @cached_property
    def lower(self) -> FloatArray:
        """Lower corner of Theta, shape (n_p,)."""
        return np.array([parameter.lower for parameter in self.parameters])

    @cached_property
    def upper(self) -> FloatArray:
        """Upper corner of Theta, shape (n_p,)."""
        return np.array([parameter.upper for parameter in self.parameters])

    @cached_property
    def scale(self) -> FloatArray:
        """Typical change of each coordinate, shape (n_p,)."""
        return np.array([parameter.scale for parameter in self.parameters])

    def project(self, points: FloatArray) -> FloatArray:
        """Return the nearest points of Theta, coordinate by coordinate, shape of `points`."""
        return np.clip(points, self.lower, self.upper)

    def contains(self, points: FloatArray) -> bool:
        """Whether every point lies in Theta."""
        return bool(np.all((points >= self.lower) & (points <= self.upper)))
