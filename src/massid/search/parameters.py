"""What is unknown: parameters with units, bounds and priors, and the space Theta that they span (Section II-B)."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from massid.errors import BadInputError
from massid.typing import FloatArray


@dataclass(frozen=True)
class Parameter:
    """One unknown number; what it does is the business of the model that takes it.

    Attributes:
        target: what it belongs to, or how it is called for short.
        nominal: the initial guess, in `unit`.
        lower: lower bound of Theta.
        upper: upper bound of Theta.
        scale: a typical change, in `unit`: samples spread by fractions of it.
        prior_std: standard deviation of the belief before the log is seen; None for no belief.
        requested: whether the user asked for it; the others are nuisances, estimated but not reported first.
        tangent: enters by the derivative of the output error instead of by identification models of its own; right for
            what acts linearly, or hardly at all.
    """

    target: str
    _: KW_ONLY
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
        """Unique in a space."""
        return self.target

    @property
    def unit(self) -> str:
        """SI unit of the value."""
        return "1"


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
