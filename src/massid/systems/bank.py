"""A bank of identification models of one system (Eq. 3), stepped all at once."""

from __future__ import annotations

import numpy as np

from massid.errors import BadInputError
from massid.search.bank import Bank, OutputErrors
from massid.systems.kernels import advance_models
from massid.systems.system import MeasuredBlock, System
from massid.typing import FloatArray


class SystemBank(Bank[MeasuredBlock]):
    """N models of a system that run side by side on the same measurements.

    Args:
        system: right-hand side, gain and what is measured.
        n_models: size of the bank N.
        timestep_s: length of a step [s].
    """

    def __init__(self, system: System, n_models: int, timestep_s: float) -> None:
        self.system = system
        self._timestep_s = timestep_s
        self._points = np.tile(system.space.nominal, (n_models, 1))
        self._state = np.zeros((n_models, system.n_x))
        self._diverged = np.zeros(n_models, dtype=np.bool_)

    @property
    def n_models(self) -> int:
        """Number of models N."""
        return len(self._points)

    @property
    def timestep_s(self) -> float:
        """Period of the output errors [s]."""
        return self._timestep_s

    def place(self, points: FloatArray) -> None:
        """Give each model its parameter estimate; points has shape (n_models, n_p)."""
        if points.shape != self._points.shape:
            raise BadInputError(f"Points of shape {points.shape} for a bank that holds {self._points.shape}.")
        self._points = np.ascontiguousarray(points, dtype=np.float64)

    def restart(self, block: MeasuredBlock, *, follows: bool = False) -> None:
        """Set every model to the best state estimate at the beginning of a block, whatever came before."""
        self._state[:] = block.start
        self._diverged[:] = False

    def advance(self, block: MeasuredBlock) -> OutputErrors:
        """Run every model through a block.

        Raises:
            BadInputError: the block has another time step than the bank.
        """
        if block.timestep_s != self._timestep_s:
            raise BadInputError(f"A block with steps of {block.timestep_s} s for a bank with {self._timestep_s} s.")
        system = self.system
        errors = np.empty((self.n_models, len(block), system.n_y))
        advance_models(
            system.compiled_rate,
            self._state,
            self._points,
            block.control,
            block.measured,
            system.columns,
            system.gain,
            self._timestep_s,
            errors,
        )
        self._diverged = self._diverged | ~np.isfinite(errors).all(axis=(1, 2))
        return OutputErrors(values=errors, diverged=self._diverged)
