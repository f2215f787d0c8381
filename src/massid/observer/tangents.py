"""Derivatives of the output error that need no identification models of their own.

Sensor errors and small errors of further masses enter (almost) linearly. Their effect on the model's state obeys the
error dynamics of the filter itself, z+ = A (z - K (z + e)) + b, with b the direct effect on one step and e that on the
measurement; one column each, for the price of a matrix product.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massid.errors import BadInputError
from massid.model.motion import Motion
from massid.model.robot import Robot
from massid.model.unknowns.unknown import unknowns_of
from massid.observer.linearisation import Lineariser, StepLinearisation
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray


class TangentFilter:
    """The columns of all unknowns, carried along a walk.

    Args:
        robot: the robot.
        space: all unknowns that the lineariser is placed with.
        contact_bodies: bodies whose wrench is measured, in the order of the blocks' columns.
        lineariser: the model at the current estimate.

    Raises:
        BadInputError: an unknown changes no body and has no effect of its own.
    """

    def __init__(
        self, robot: Robot, space: ParameterSpace, contact_bodies: Sequence[str], lineariser: Lineariser
    ) -> None:
        self._lineariser = lineariser
        self._unknowns, self._channels = unknowns_of(space), robot.channels(contact_bodies)
        self._measured: FloatArray = np.zeros((2 * robot.model.nv, len(space)))
        changing = robot.realise(space, space.nominal, contact_bodies).inertia_slopes.unknowns
        rest, blind = Motion.at_rest(self._channels), []
        for column, unknown in enumerate(self._unknowns):
            effect = unknown.effect(rest, self._channels)
            if effect.measured is not None:
                self._measured[:, column] = effect.measured
            if effect.is_nothing and column not in changing:
                blind.append(unknown.name)
        if blind:
            raise BadInputError(
                f"{', '.join(blind)}: what it does to a motion is not known, and a log with noise cannot tell of it: "
                "its class needs an `effect`, or must change bodies."
            )
        self._state: FloatArray = -self._measured
        self._acting: tuple[FloatArray, FloatArray] = (np.zeros((len(space), 0, 0)),) * 2

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self._state.T)

    @property
    def state(self) -> FloatArray:
        """Derivative of the model's state by each unknown, shape (2 nv, n_p)."""
        return self._state

    def restart(self) -> None:
        """The state is the measurement, whatever the unknowns; what that shows too much is all that is in it."""
        self._state = -self._measured

    def enter(self, motion: Motion) -> None:
        """Find what a unit more of each unknown does along a block, whose steps are taken next."""
        n, count = len(motion), self.count
        force, wrench = np.zeros((count, *motion.velocity.shape)), np.zeros((count, *motion.wrench.shape))
        for column, unknown in enumerate(self._unknowns):
            effect = unknown.effect(motion, self._channels)
            if effect.force is not None:
                force[column] = effect.force
            if effect.wrench is not None:
                wrench[column] = effect.wrench
        changing = self._lineariser.changing
        asked = np.array([self._lineariser.inertial_forces(motion, k) for k in range(n)])
        for row, column in enumerate(changing):
            force[column] -= asked[:, :, row]
        self._acting = force, wrench

    def step(self, k: int, gain: FloatArray, linear: StepLinearisation) -> FloatArray:
        """Advance by step k of the block; returns the derivative of y^ - y after it, shape (2 nv, n_p)."""
        force, wrench = self._acting
        corrected = self._state - gain @ (self._state + self._measured)
        self._state = linear.transition @ corrected
        self._state += linear.from_force @ force[:, k].T
        self._state += linear.from_wrench @ wrench[:, k].T
        return self._state + self._measured
