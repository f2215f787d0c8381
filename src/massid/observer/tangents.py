"""Derivatives of the output error that need no identification models of their own.

Sensor errors and small errors of further masses enter (almost) linearly. Their effect on the model's state obeys the
error dynamics of the filter itself, z+ = A (z - K (z + e)) + b, with b the direct effect on one step and e that on the
measurement; one column each, for the price of a matrix product.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from massid.errors import BadInputError
from massid.model.motion import Motion
from massid.model.robot import Robot
from massid.model.unknowns.unknown import unknowns_of
from massid.observer.linearisation import Lineariser, StepLinearisation
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray, IntArray


@dataclass(frozen=True)
class ClosedLoop:
    """How an error of the state, and one of the measurement, go into the state after a step: A (1 - K) and A K.

    Attributes:
        transition: shape (2 nv, 2 nv).
        injection: shape (2 nv, 2 nv).
    """

    transition: FloatArray
    injection: FloatArray


class TangentFilter:
    """The columns of all unknowns, carried along a walk.

    Args:
        robot: the robot.
        space: all unknowns that the lineariser is placed with.
        contact_bodies: bodies whose wrench is measured, in the order of the blocks' columns.
        lineariser: the model at the current estimate.
        columns: which of the unknowns; default all.

    Raises:
        BadInputError: an unknown changes no body and has no effect of its own.
    """

    def __init__(
        self,
        robot: Robot,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        lineariser: Lineariser,
        columns: IntArray | None = None,
    ) -> None:
        self._lineariser = lineariser
        self._columns = np.arange(len(space)) if columns is None else columns
        self._unknowns = [unknowns_of(space)[k] for k in self._columns]
        self._channels = robot.channels(contact_bodies)
        self._measured: FloatArray = np.zeros((2 * robot.model.nv, self.count))
        self._changing = robot.realise(space, space.nominal, contact_bodies).inertia_slopes.unknowns
        rest, blind = Motion.at_rest(self._channels), []
        for row, unknown in enumerate(self._unknowns):
            effect = unknown.effect(rest, self._channels)
            if effect.measured is not None:
                self._measured[:, row] = effect.measured
            if effect.is_nothing and self._columns[row] not in self._changing:
                blind.append(unknown.name)
        if blind:
            raise BadInputError(
                f"{', '.join(blind)}: what it does to a motion is not known, and a log with noise cannot tell of it: "
                "its class needs an `effect`, or must change bodies."
            )
        self._offset = np.flatnonzero(self._measured.any(axis=0))
        self._state: FloatArray = -self._measured
        self._acting: tuple[FloatArray, FloatArray] = (np.zeros((self.count, 0, 0)),) * 2

    @property
    def columns(self) -> IntArray:
        """Which of the unknowns have columns, shape (n_p,)."""
        return self._columns

    @property
    def depend_on_inputs(self) -> IntArray:
        """Those of the columns that torques, wrenches and their rates change, or what these accelerate, shape (m,)."""
        rest = Motion.at_rest(self._channels)
        loaded = replace(rest, loaded=rest.loaded + 1.0)
        reading = ("acceleration", "effort", "wrench", "effort_rate", "wrench_rate")
        acting = replace(loaded, **{name: getattr(rest, name) + 1.0 for name in reading})
        found = []
        for column, unknown in zip(self._columns, self._unknowns, strict=True):
            before, after = unknown.effect(loaded, self._channels), unknown.effect(acting, self._channels)
            same = all(np.array_equal(getattr(before, part), getattr(after, part)) for part in ("force", "wrench"))
            if column in self._changing or not same:
                found.append(column)
        return np.array(found, dtype=np.int64)

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self._columns)

    @property
    def state(self) -> FloatArray:
        """Derivative of the model's state by each unknown, shape (2 nv, n_p)."""
        return self._state

    def restart(self) -> None:
        """The state is the measurement, whatever the unknowns; what that shows too much is all that is in it."""
        self._state = -self._measured

    def enter(self, motion: Motion) -> None:
        """Find what a unit more of each unknown does along a block, whose steps are taken next."""
        count = self.count
        force, wrench = np.zeros((count, *motion.velocity.shape)), np.zeros((count, *motion.wrench.shape))
        for column, unknown in enumerate(self._unknowns):
            effect = unknown.effect(motion, self._channels)
            if effect.force is not None:
                force[column] = effect.force
            if effect.wrench is not None:
                wrench[column] = effect.wrench
        row_of = {column: row for row, column in enumerate(self._columns.tolist())}
        asked = self._lineariser.inertial_forces(motion)
        for k, column in enumerate(self._lineariser.changing.tolist()):
            if column in row_of:
                force[row_of[column]] -= asked[:, :, k]
        # Samples first, so that what acts in a step lies in one piece.
        self._acting = np.ascontiguousarray(force.transpose(1, 2, 0)), np.ascontiguousarray(wrench.transpose(1, 2, 0))

    def step(self, k: int, loop: ClosedLoop, linear: StepLinearisation) -> FloatArray:
        """Advance by step k of the block; returns the derivative of y^ - y after it, shape (2 nv, n_p)."""
        force, wrench = self._acting
        state = loop.transition @ self._state
        if len(self._offset):
            state[:, self._offset] -= loop.injection @ self._measured[:, self._offset]
        state += linear.from_force @ force[k]
        state += linear.from_wrench @ wrench[k]
        self._state = state
        return state + self._measured
