"""What is unknown: parameters with units, bounds and priors, and the space Theta that they span (Section II-B)."""

from __future__ import annotations

import enum
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from massid.errors import BadInputError
from massid.typing import FloatArray

THETA_LOWER, THETA_UPPER = 0.3, 2.5
"""Default bounds of a mass, as multiples of its nominal value."""


class Kind(enum.StrEnum):
    """How a parameter acts on an identification model."""

    MASS = "mass"
    """Mass of a link; its rotational inertia scales with it, its centre of mass stays."""
    COM = "com"
    """Centre of mass of a link in the frame of its body; target BODY/AXIS with axes x, y, z."""
    INERTIA = "inertia"
    """Rotational inertia of a link about its centre of mass, in log-Cholesky numbers of its pseudo-inertia, zero for
    the model file's; target BODY/ENTRY. Any value belongs to a body that can exist."""
    INERTIA_SCALE = "inertia_scale"
    """Rotational inertia of a link about its centre of mass, all of it by one factor: its natural logarithm."""
    PAYLOAD = "payload"
    """A point mass carried by a body; target BODY@X,Y,Z, a point in the frame of the body."""
    FRICTION = "friction"
    """Friction loss of a joint."""
    DAMPING = "damping"
    """Viscous damping of a joint."""
    EFFORT_OFFSET = "effort_offset"
    """What a joint's torque sensor reads too much."""
    EFFORT_GAIN = "effort_gain"
    """Relative error of a joint's torque sensor: reading = (1 + gain) torque + offset."""
    EFFORT_LAG = "effort_lag"
    """How much later than the joint states the joint torques are stamped, all alike; target ALL."""
    WRENCH_OFFSET = "wrench_offset"
    """What one axis of a contact sensor reads too much; target BODY/AXIS, axes 0-2 force, 3-5 moment."""
    WRENCH_GAIN = "wrench_gain"
    """Relative error of one axis of a contact sensor; target BODY/AXIS."""
    WRENCH_LAG = "wrench_lag"
    """How much later than the joint states the contact wrenches are stamped, all alike; target ALL."""
    ENCODER_OFFSET = "encoder_offset"
    """What a joint's encoder reads too much."""
    COEFFICIENT = "coefficient"
    """A number in the right-hand side of a system of one's own, without a unit; robots have none."""


UNITS = {
    Kind.MASS: "kg",
    Kind.COM: "m",
    Kind.INERTIA: "1",
    Kind.INERTIA_SCALE: "1",
    Kind.PAYLOAD: "kg",
    Kind.FRICTION: "N m",
    Kind.DAMPING: "N m s/rad",
    Kind.EFFORT_OFFSET: "N m",
    Kind.EFFORT_GAIN: "1",
    Kind.EFFORT_LAG: "s",
    Kind.WRENCH_OFFSET: "N",
    Kind.WRENCH_GAIN: "1",
    Kind.WRENCH_LAG: "s",
    Kind.ENCODER_OFFSET: "rad",
    Kind.COEFFICIENT: "1",
}
_INERTIAL = (Kind.MASS, Kind.COM, Kind.INERTIA, Kind.INERTIA_SCALE, Kind.PAYLOAD)
_SENSOR_ERRORS = (
    Kind.EFFORT_OFFSET,
    Kind.EFFORT_GAIN,
    Kind.EFFORT_LAG,
    Kind.WRENCH_OFFSET,
    Kind.WRENCH_GAIN,
    Kind.WRENCH_LAG,
    Kind.ENCODER_OFFSET,
)
_FORCE_AXES = 3
"""Axes of a contact sensor that come before its moments."""
ALL = "all"
"""Target of what is one number for all sensors of a kind."""


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
        tangent: enters by the derivative of the output error instead of by identification models of its own; right for
            what acts linearly, or hardly at all.
    """

    kind: Kind
    target: str
    nominal: float
    lower: float
    upper: float
    scale: float
    prior_std: float | None = None
    requested: bool = True
    tangent: bool = False

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
    def per_walk(self) -> bool:
        """Whether it is an error of a sensor, constant within a walk and another one in the next."""
        return self.kind in _SENSOR_ERRORS

    @property
    def is_inertial(self) -> bool:
        """Whether it changes how a body's mass lies."""
        return self.kind in _INERTIAL

    @property
    def is_passive(self) -> bool:
        """Whether it is a torque of a joint that no motor makes."""
        return self.kind in (Kind.FRICTION, Kind.DAMPING)

    @property
    def adds_mass(self) -> bool:
        """Whether it is a part of the whole robot's mass."""
        return self.kind in (Kind.MASS, Kind.PAYLOAD)

    @property
    def body(self) -> str:
        """Name of the body that an inertial parameter belongs to."""
        match self.kind:
            case Kind.COM | Kind.INERTIA:
                return self.target.rpartition("/")[0]
            case Kind.PAYLOAD:
                return self.target.rpartition("@")[0]
            case _:
                return self.target

    @property
    def entry(self) -> str:
        """Axis or number among those of one body or sensor, after the last slash of the target."""
        return self.target.rpartition("/")[2]

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        if self.kind is Kind.WRENCH_OFFSET and int(self.entry.partition("@")[0]) >= _FORCE_AXES:
            return "N m"
        return UNITS[self.kind]

    @classmethod
    def nuisance(cls, kind: Kind, target: str, prior_std: float, nominal: float = 0.0) -> Parameter:
        """Something that is not asked for and not exactly known; estimated within eight deviations of its prior."""
        reach = 8.0 * prior_std
        return cls(
            kind=kind,
            target=target,
            nominal=nominal,
            lower=nominal - reach,
            upper=nominal + reach,
            scale=prior_std,
            prior_std=prior_std,
            requested=False,
            tangent=True,
        )

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
        if any(first.tangent and not second.tangent for first, second in pairwise(self.parameters)):
            raise BadInputError("Parameters that enter by their derivative must come last.")

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def n_sampled(self) -> int:
        """Parameters that identification models are sampled in; the others, which come last, are tangents."""
        return sum(not parameter.tangent for parameter in self.parameters)

    @property
    def tangents(self) -> tuple[Parameter, ...]:
        """Parameters that enter by the derivative of the output error."""
        return self.parameters[self.n_sampled :]

    @property
    def names(self) -> tuple[str, ...]:
        """Unique name of each coordinate."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def adds_mass(self) -> FloatArray:
        """1 for the coordinates that are a part of the whole robot's mass, else 0, shape (n_p,)."""
        return np.array([float(parameter.adds_mass) for parameter in self.parameters])

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

    @cached_property
    def prior_precision(self) -> FloatArray:
        """Inverse prior variance of each coordinate, 0 where nothing is believed, shape (n_p,)."""
        return np.array([0.0 if p.prior_std is None else p.prior_std**-2 for p in self.parameters])
