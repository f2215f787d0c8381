"""Derivatives of the output error that need no identification models of their own.

Sensor errors and small errors of further masses enter (almost) linearly. Their effect on the model's state obeys the
error dynamics of the filter itself, z+ = A (z - K (z + e)) + b, with b the direct effect on one step and e that on the
measurement; one column each, for the price of a matrix product.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massid.model.robot import Robot
from massid.observer.inputs import BelievedBlock
from massid.observer.linearisation import Lineariser, StepLinearisation
from massid.search.parameters import Kind, Parameter
from massid.typing import FloatArray, IntArray


class TangentFilter:
    """The columns of all tangent parameters, carried along a walk.

    Args:
        robot: the robot.
        tangents: all parameters that the lineariser is placed with, in their order.
        contact_bodies: bodies whose wrench is measured, in the order of the blocks' columns.
        lineariser: the model at the current estimate.
    """

    def __init__(
        self, robot: Robot, tangents: Sequence[Parameter], contact_bodies: Sequence[str], lineariser: Lineariser
    ) -> None:
        self._lineariser = lineariser
        n_v, layout = robot.model.nv, robot.layout
        inertial: list[int] = []
        bodies: list[int] = []
        columns: dict[Kind, list[int]] = {kind: [] for kind in Kind}
        sources: dict[Kind, list[int]] = {kind: [] for kind in Kind}
        for column, parameter in enumerate(tangents):
            if parameter.is_inertial:
                inertial.append(column)
                bodies.append(robot.model.body(parameter.body).id)
                continue
            columns[parameter.kind].append(column)
            source = robot.sensor_column(parameter, contact_bodies)  # of a torque sensor, as of a joint
            sources[parameter.kind].append(source)
        self._inertial, self._bodies = _ids(inertial), _ids(bodies)
        self._columns = {kind: _ids(found) for kind, found in columns.items() if found}
        self._sources = {kind: _ids(found) for kind, found in sources.items() if found}
        self._joint_dof = layout.joint_dof
        self._measured: FloatArray = np.zeros((2 * n_v, len(tangents)))
        if Kind.ENCODER_OFFSET in self._columns:
            rows = layout.joint_dof[self._sources[Kind.ENCODER_OFFSET]]
            self._measured[rows, self._columns[Kind.ENCODER_OFFSET]] = 1.0
        self._state: FloatArray = -self._measured

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self._state.T)

    @property
    def state(self) -> FloatArray:
        """Derivative of the model's state by each tangent parameter, shape (2 nv, n_tangents)."""
        return self._state

    def restart(self) -> None:
        """The state is the measurement, whatever the parameters; only an encoder's offset is in it."""
        self._state = -self._measured

    def step(self, block: BelievedBlock, k: int, gain: FloatArray, linear: StepLinearisation) -> FloatArray:
        """Advance by one step; returns the derivative of y^ - y after it, shape (2 nv, n_tangents)."""
        corrected = self._state - gain @ (self._state + self._measured)
        self._state = linear.transition @ corrected + self._direct(block, k, linear)
        return self._state + self._measured

    def _direct(self, block: BelievedBlock, k: int, linear: StepLinearisation) -> FloatArray:
        """Effect of each parameter on one step: a sensor that reads too much makes the input smaller."""
        out = np.zeros_like(self._state)
        if len(self._inertial):
            forces = self._lineariser.inertial_forces(block, k, self._bodies, self._inertial)
            out[:, self._inertial] = -linear.from_force @ forces
        torque, speed = block.motion.effort[k, self._joint_dof], block.motion.velocity[k, self._joint_dof]
        for kind, columns in self._columns.items():
            source = self._sources[kind]
            match kind:
                case Kind.EFFORT_OFFSET:
                    out[:, columns] = -linear.from_effort[:, source]
                case Kind.EFFORT_GAIN:
                    out[:, columns] = -linear.from_effort[:, source] * torque[source]
                case Kind.EFFORT_LAG:  # what acts is what is read later
                    out[:, columns] = (linear.from_force @ block.motion.effort_rate[k])[:, None]
                case Kind.WRENCH_LAG:
                    out[:, columns] = (linear.from_wrench @ block.motion.wrench_rate[k])[:, None]
                case Kind.WRENCH_OFFSET:
                    out[:, columns] = -linear.from_wrench[:, source] * block.loaded[k, source]
                case Kind.WRENCH_GAIN:
                    out[:, columns] = -linear.from_wrench[:, source] * block.motion.wrench[k, source]
                case Kind.FRICTION:
                    out[:, columns] = linear.from_effort[:, source] * block.sliding[k, source]
                case Kind.DAMPING:
                    out[:, columns] = -linear.from_effort[:, source] * speed[source]
                case _:  # an encoder's offset acts on the measurement alone
                    pass
        return out


def _ids(values: Sequence[int]) -> IntArray:
    return np.asarray(values, dtype=np.int64)
