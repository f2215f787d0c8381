"""A dynamic system with unknown parameters, written as one function, and what is measured of it (Eq. 1).

Whoever brings a system of their own writes the right-hand side as plain scalar code and names the unknowns:

    def rate(x, p, u, dx):
        dx[0] = x[1]
        dx[1] = u[0] - p[0] * math.sin(x[0]) - p[1] * x[1]

Numba compiles it; plant, identification models and observers all run it (see `massid.systems.kernels`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from massid.errors import BadInputError
from massid.search.parameters import Parameter, ParameterSpace
from massid.systems.kernels import compiled
from massid.typing import FloatArray, IntArray

Rate: TypeAlias = Callable[[Any, Any, Any, Any], None]
"""f of Eq. (1): (state, parameters, input, out) -> None; writes dx/dt. Scalar code that numba can compile."""


def coefficient(name: str, nominal: float, lower: float, upper: float, scale: float | None = None) -> Parameter:
    """An unknown coefficient of a system.

    Args:
        name: how it is called.
        nominal: the initial guess.
        lower: lower end of Theta.
        upper: upper end of Theta.
        scale: a typical change; default a quarter of Theta's width.
    """
    scale = 0.25 * (upper - lower) if scale is None else scale
    return Parameter(name, nominal=nominal, lower=lower, upper=upper, scale=scale)


@dataclass(frozen=True)
class System:
    """x' = f(x, p, u), y = the measured states, and the identification model that goes with it.

    The model (Eq. 3) is x_hat' = f(z, p, u) + K (y - y_hat), where z is the model's state with the measured states put
    in their places. With the whole state measured that is Eq. (17) and Eq. (20): f acts on the measurement, and the
    gain alone on the model. With p = p* and the same initial state the error stays zero, whatever is measured.

    Attributes:
        name: how the system is called.
        rate: f; see `Rate`.
        n_x: number of states.
        n_u: number of inputs.
        space: the unknowns, their initial guess and Theta.
        gain: K, shape (n_x, n_y).
        measured: indices of the measured states, n_y of them; default all.
    """

    name: str
    rate: Rate
    n_x: int
    n_u: int
    space: ParameterSpace
    gain: FloatArray
    measured: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not self.measured:
            object.__setattr__(self, "measured", tuple(range(self.n_x)))
        object.__setattr__(self, "gain", np.ascontiguousarray(self.gain, dtype=np.float64))
        if any(not 0 <= index < self.n_x for index in self.measured):
            raise BadInputError(f"{self.name}: measured states {self.measured} must lie in 0 .. {self.n_x - 1}.")
        if self.gain.shape != (self.n_x, len(self.measured)):
            raise BadInputError(
                f"{self.name}: the gain has shape {self.gain.shape}; {self.n_x} states and {len(self.measured)} "
                f"measured ones need {(self.n_x, len(self.measured))}."
            )

    @property
    def n_y(self) -> int:
        """Number of measured states."""
        return len(self.measured)

    @property
    def whole_state(self) -> bool:
        """Whether every state is measured (Assumption 1)."""
        return self.measured == tuple(range(self.n_x))

    @cached_property
    def columns(self) -> IntArray:
        """Indices of the measured states, shape (n_y,)."""
        return np.asarray(self.measured, dtype=np.int64)

    @cached_property
    def compiled_rate(self) -> Any:
        """The right-hand side, compiled."""
        return compiled(self.rate)


@dataclass(frozen=True)
class MeasuredBlock:
    """Measurements of n steps, sampled at every half step so that RK4 finds its stages in them.

    Attributes:
        start: the best state estimate at the beginning of the block, shape (n_x,); all of it measured under
            Assumption 1.
        measured: y at the half steps, shape (2 n + 1, n_y).
        control: u, held over each step, shape (n, n_u).
        timestep_s: length of a step [s].
    """

    start: FloatArray
    measured: FloatArray
    control: FloatArray
    timestep_s: float

    def __len__(self) -> int:
        return len(self.control)

    @property
    def duration_s(self) -> float:
        """Length of the block [s]."""
        return len(self) * self.timestep_s
