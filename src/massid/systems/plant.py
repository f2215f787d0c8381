"""The true system under its controller: makes the measurements that identification models are compared with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np

from massid.errors import BadInputError
from massid.systems.kernels import compiled, simulate_plant
from massid.systems.system import MeasuredBlock, System
from massid.typing import FloatArray

ControlLaw: TypeAlias = Callable[[Any, Any, Any, Any, Any], None]
"""law(time, state, estimate, settings, out) -> None; writes u. Scalar code that numba can compile."""


@dataclass(frozen=True)
class Controller:
    """What drives the plant; it may use the running estimate (Eq. 21).

    Attributes:
        law: see `ControlLaw`.
        settings: numbers that it is called with, shape (n,).
    """

    law: ControlLaw
    settings: FloatArray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Disturbance:
    """Zero-mean Gaussian noise on dx/dt, held over a while (Delta of Eq. 19).

    Attributes:
        deviation: standard deviation of each state's rate, shape (n_x,).
        hold_s: how long each draw is held [s].
    """

    deviation: FloatArray
    hold_s: float

    def draw(self, n: int, first: int, period_s: float, rng: np.random.Generator) -> FloatArray:
        """Noise of the next n periods of the integrator, shape (n, n_x); a draw begins where a hold begins.

        Raises:
            BadInputError: they do not begin and end with a hold.
        """
        hold = max(1, round(self.hold_s / period_s))
        if first % hold or n % hold:
            raise BadInputError(
                f"A window of {n * period_s:g} s does not hold a whole number of noise holds of {self.hold_s} s."
            )
        draws = rng.normal(size=(n // hold, len(self.deviation))) * self.deviation
        return np.repeat(draws, hold, axis=0)


class Plant:
    """The simulated truth, in closed loop. Nothing of it but measurements reaches the search.

    Args:
        system: right-hand side, and what is measured.
        truth: p*, shape (n_p,), or a function of time [s] that gives it.
        controller: what drives it.
        start: initial state, shape (n_x,).
        timestep_s: period of the controller [s]; the plant is integrated and measured at half of it.
        disturbance: noise on dx/dt; default none.
        observer_gain: gain of the observer that recovers the states that are not measured, shape (n_x, n_y); needed
            only where some are not.
        rng: source of the noise.
    """

    def __init__(
        self,
        system: System,
        truth: FloatArray | Callable[[float], FloatArray],
        controller: Controller,
        start: FloatArray,
        timestep_s: float = 1e-3,
        disturbance: Disturbance | None = None,
        observer_gain: FloatArray | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        if observer_gain is None:
            if not system.whole_state:
                raise BadInputError(f"{system.name}: only states {system.measured} are measured; give observer_gain.")
            observer_gain = np.zeros((system.n_x, system.n_y))
        self.system = system
        self.timestep_s = timestep_s
        self.controller = controller
        self.state = np.array(start, dtype=np.float64)
        self._observed = np.zeros(system.n_x)
        self._observed[system.columns] = self.state[system.columns]
        self._truth = truth if callable(truth) else np.asarray(truth, dtype=np.float64)
        self._disturbance = disturbance
        self._observer_gain = np.ascontiguousarray(observer_gain, dtype=np.float64)
        self._rng = rng or np.random.default_rng(0)
        self._step = 0

    @property
    def time_s(self) -> float:
        """Time since the beginning [s]."""
        return self._step * self.timestep_s

    def truth(self, time_s: float) -> FloatArray:
        """p* at a time, shape (n_p,): for those who score an estimate."""
        return self._truth(time_s) if callable(self._truth) else self._truth

    def run(self, duration_s: float, estimate: FloatArray) -> Motion:
        """Run for a while with the controller at an estimate.

        Args:
            duration_s: how long [s].
            estimate: the running estimate that the controller compensates with, shape (n_p,).

        Raises:
            BadInputError: the plant left the finite numbers: the controller does not hold it.
        """
        n, system = round(duration_s / self.timestep_s), self.system
        start = self._observed.copy()
        states, control = np.empty((2 * n + 1, system.n_x)), np.zeros((n, system.n_u))
        noise = np.zeros((2 * n, system.n_x))
        if self._disturbance is not None:
            noise = self._disturbance.draw(2 * n, 2 * self._step, 0.5 * self.timestep_s, self._rng)
        times: FloatArray = self.timestep_s * np.arange(self._step, self._step + n, dtype=np.float64)
        truth = (
            np.array([self._truth(time) for time in times]) if callable(self._truth) else np.tile(self._truth, (n, 1))
        )
        simulate_plant(
            system.compiled_rate,
            compiled(self.controller.law),
            np.asarray(self.controller.settings, dtype=np.float64),
            self.state,
            self._observed,
            truth,
            np.asarray(estimate, dtype=np.float64),
            noise,
            self.time_s,
            self.timestep_s,
            system.columns,
            self._observer_gain,
            states,
            control,
        )
        if not np.isfinite(states).all():
            raise BadInputError(f"{system.name} left the finite numbers after {self.time_s:.3g} s of control.")
        block = MeasuredBlock(
            start=start,
            measured=np.ascontiguousarray(states[:, system.columns]),
            control=control,
            timestep_s=self.timestep_s,
        )
        self._step += n
        return Motion(times_s=times, states=states[:-1:2], block=block)


@dataclass(frozen=True)
class Motion:
    """What the plant did over a while.

    Attributes:
        times_s: beginning of each step [s], shape (n,).
        states: x at the beginning of each step, shape (n, n_x): truth, for those who score.
        block: what was measured of it.
    """

    times_s: FloatArray
    states: FloatArray
    block: MeasuredBlock
