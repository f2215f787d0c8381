"""Dry friction of joints under sensor noise: who sticks, who slides, and what a wrong guess would do.

Friction loss in the engine answers to every step's input. Noise in the measured wrenches shakes a light joint of the
model that stuck, or slid steadily, in reality, and shaken friction averages to less than it was: masses then make up
for what is missing. Whether a joint sticks is therefore not left to the noisy models but decided once, from averaged
measurements. Friction that slides is then a known torque, and the friction of a joint that sticks is the engine's own
without its limit, which is linear: noise averages out of both. Where the decision is in doubt, the error that it may
make counts as noise of the joint's torque.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.special import ndtr

from massid.model.layout import JointLayout
from massid.model.realisation import Realisation, write_fields
from massid.observer.friction_demand import Demand, FrictionSolver
from massid.observer.spans import Spans
from massid.typing import BoolArray, FloatArray
from massid.walk.noise import SensorNoise

DOUBT_S = 0.2
"""How long a joint's friction is taken to be wrong by the same amount [s]."""
_WEIGHT = 5.0
"""An error that returns with every step of a walk does not average out: it counts that many times as large."""
_UNIFORM = 3.0**-0.5
"""Deviation of what may be anything up to 1 in size."""
_SURE = 3.0
"""Standard deviations beyond which something is sure."""
_DROWNS = 2.0
"""Factor by which noise must exceed every friction loss at one sample for none to stand out at those around it."""
_SATURATED = 0.999
"""Share of the friction loss at which friction has no reserve left; the engine's constraint is soft."""
_BLUR = 0.3
"""Standard deviation of what an average hides of a sudden change, relative to it: 1 / sqrt(12)."""


@dataclass(frozen=True)
class Friction:
    """Dry friction of joints along a motion.

    Attributes:
        torque: that acts besides, zero where the joint sticks, shape (n, n_joints) [N m].
        sticks: whether the engine is to hold the joint, whatever that takes, shape (n, n_joints).
        variance: of white torque noise that stands for what is not known of it, shape (n, n_joints) [N^2 m^2].
        sliding: direction of the torque, 1 or -1, where the joint surely slides, else 0; the derivative of the torque
            by the friction loss, as far as it is known. Shape (n, n_joints).
    """

    torque: FloatArray
    sticks: BoolArray
    variance: FloatArray
    sliding: FloatArray

    @classmethod
    def none(cls, n: int, n_joints: int) -> Friction:
        """Joints without friction."""
        zeros = np.zeros((n, n_joints))
        return cls(zeros, zeros > 0.0, zeros, zeros)

    def rows(self, first: int, count: int) -> Friction:
        """Some of the samples."""
        return Friction(**{name: rows[first : first + count] for name, rows in vars(self).items()})

    def where(self, condition: BoolArray, other: Friction) -> Friction:
        """This one where a condition holds, shape (n, n_joints), else the other."""
        return Friction(**{name: np.where(condition, own, vars(other)[name]) for name, own in vars(self).items()})


class StickSlip:
    """Tells the friction of the joints along a measured motion.

    Args:
        model: identification model with its friction loss.
        layout: addresses of the one-axis joints.
        noise: of the sensors.
        timestep_s: sample period [s].
    """

    def __init__(self, model: mujoco.MjModel, layout: JointLayout, noise: SensorNoise, timestep_s: float) -> None:
        self._model = copy.copy(model)
        self._timestep_s = timestep_s
        self._solver = FrictionSolver(self._model, layout, noise)
        self._joint_dof = layout.joint_dof
        spans = Spans.at(timestep_s)
        self._brief, self._width = spans.brief_width, spans.width
        self._velocity_std = noise.joint_velocity / np.sqrt(self._width)

    @property
    def reach(self) -> int:
        """Samples before and after one that bear upon it: a joint is uncertain next to where an average says so."""
        return self._width - 1

    def place(self, realisation: Realisation) -> None:
        """Take the parameters of the first of N models."""
        write_fields(self._model, realisation)

    def friction(self, qpos: FloatArray, qvel: FloatArray, force: FloatArray, wrench: FloatArray) -> Friction:
        """Friction of every joint, and what is not certain of it.

        Args:
            qpos: measured positions, shape (n, nq) [rad or m].
            qvel: measured velocities, shape (n, nv) [rad/s or m/s].
            force: measured torques as generalised forces, shape (n, nv) [N m or N].
            wrench: measured wrenches, shape (n, 6 n_contacts) [N, N m].
        """
        loss = self._model.dof_frictionloss[self._joint_dof]
        if np.all(_SURE * self._solver.deviation(qpos[0], qvel[0], averaged=self._brief) > _DROWNS * loss):
            return self._told_by_speed(qpos, (qvel, force, wrench), loss)
        averages = _averaged(qvel, force, wrench, width=self._brief)
        demand = self._solver.solve(qpos, averages[0], averages[1], averages[2], averaged=self._brief)
        stands_out = _SURE * demand.std < loss
        found = self._told_by_torque(demand, loss)
        if stands_out.all():
            return found
        return found.where(stands_out, self._told_by_speed(qpos, (qvel, force, wrench), loss))

    def _told_by_torque(self, demand: Demand, loss: FloatArray) -> Friction:
        """Of a friction loss well above the noise: a joint sticks if that takes less than the loss.

        Let x be the torque needed. If the joint slides but is taken to stick, it is held by x - loss too much; and the
        other way round. With x known to a deviation d, and a distance m d from the loss, the mean square of that error
        is d^2 ((1 + m^2) Q(m) - m phi(m)), of the normal distribution's tail Q and density phi.
        """
        width = self._brief
        highest, lowest = (
            f(demand.needed, width, axis=0, mode="nearest") for f in (maximum_filter1d, minimum_filter1d)
        )
        deviation = np.hypot(demand.std, _BLUR * (highest - lowest))
        sticks = np.abs(demand.needed) < loss
        m = np.abs(loss - np.abs(demand.needed)) / np.where(deviation > 0.0, deviation, 1.0)
        error = deviation * np.sqrt(
            np.maximum((1.0 + m**2) * ndtr(-m) - m * np.exp(-(m**2) / 2.0) / np.sqrt(2.0 * np.pi), 0.0)
        )
        return Friction(
            torque=np.where(sticks, 0.0, np.clip(demand.needed, -loss, loss)),
            sticks=sticks,
            variance=self._as_noise(np.minimum(_WEIGHT * error, loss), DOUBT_S),
            sliding=np.sign(demand.needed) * (~sticks & (m > _SURE)),
        )

    def _told_by_speed(self, qpos: FloatArray, readings: tuple[FloatArray, ...], loss: FloatArray) -> Friction:
        """Of a friction loss that noise drowns: it is known if the joint surely moves, else anything up to the loss.

        Then it is what the engine makes of averaged readings, whose noise is another one an average later.
        """
        qvel, force, wrench = _averaged(*readings, width=self._width)
        torque, speed = self._solver.torque(qpos, qvel, force, wrench), qvel[:, self._joint_dof]
        slides = (np.abs(speed) > _SURE * self._velocity_std) & (np.abs(torque) >= _SATURATED * loss)
        slides &= torque * speed <= 0.0  # a joint that turns round has friction of the other sign for a moment
        slides = minimum_filter1d(slides, self._width, axis=0, mode="nearest")
        return Friction(
            torque=torque,
            sticks=np.zeros_like(slides),
            variance=self._as_noise(np.where(slides, 0.0, _UNIFORM * loss), self._width * self._timestep_s),
            sliding=-np.sign(speed) * slides,
        )

    def _as_noise(self, torque: FloatArray, lasting_s: float) -> FloatArray:
        """Variance of white noise with the impulse of a torque that is wrong for as long as doubt lasts [N^2 m^2]."""
        return np.asarray(torque**2 * lasting_s / self._timestep_s)


def _averaged(*readings: FloatArray, width: int) -> list[FloatArray]:
    return [uniform_filter1d(rows, width, axis=0, mode="mirror") for rows in readings]
