"""What noisy measurements are taken to mean: unloaded feet, sticking joints, and the motion around a sample.

Columns of the Jacobian are made of the motion that is estimated here, not of what each sample says. Noise in a column
that is also in the output error would look like information: a light foot that one sample of torque noise seems to
accelerate by 30 rad/s^2 would be weighed by that noise. The motion at a sample is therefore taken from its neighbours
on both sides, without the sample itself and those next to it, and accelerations from measured velocities instead of
forces. Such a column has next to nothing in common with the error that it is multiplied by, and the estimate stays
unbiased however well the noise levels are known (the method of instrumental variables).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from massid.model.layout import JointLayout
from massid.model.motion import Motion
from massid.model.realisation import Realisation, SensorErrors
from massid.observer.contact_gate import ForceOffsets, is_unloaded
from massid.observer.friction import Friction, StickSlip
from massid.observer.kernels import correct_state
from massid.observer.neighbours import level, slope
from massid.observer.replay import ReplayBlock
from massid.observer.spans import REACH_S, Spans
from massid.typing import BoolArray, FloatArray, IntArray
from massid.walk.noise import SensorNoise

UNLIMITED = 1e9
"""Friction loss of a joint that sticks, whatever that takes [N m or N]."""


@dataclass(frozen=True, kw_only=True)
class BelievedBlock(ReplayBlock):
    """A block with what is believed of its inputs.

    Attributes:
        friction: friction torques that act besides, zero at the base, shape (n, nv) [N m or N].
        friction_loss: that the engine is to have: without limit where a joint sticks, else 0, shape (n, nv) [N m or N].
        friction_variance: of white noise that stands for unknown friction, shape (n, n_joints) [N^2 m^2].
        unknown: where a wrench may act that no sensor reads, shape (n, 6 n_c).
        motion: what the columns of the Jacobian are made of: averages around the samples, but for the positions.
        readings: the same motion with torques and wrenches as they were read, which is what drives the models; its
            accelerations are left to whoever has a model.
    """

    friction: FloatArray
    friction_loss: FloatArray
    friction_variance: FloatArray
    unknown: BoolArray
    motion: Motion
    readings: Motion

    def generalised_force(self, k: int) -> FloatArray:
        """Everything but the wrenches that acts in step k, shape (nv,) [N m or N]."""
        return np.asarray(self.effort[k] + self.friction[k])


class InputBelief:
    """Judges blocks that follow one another.

    Args:
        model: identification model with its friction loss.
        layout: addresses of the free joint and the one-axis joints.
        noise: of the sensors.
        timestep_s: sample period; default the time step of the model [s].
        reach_s: how far around a sample its motion is averaged [s].
        unknown_friction: whether friction losses are to be found, be they zero in the model.
        offsets: what is believed of the contact sensors; default how large their errors may be.
        open_axes: columns of the wrenches that no sensor measures.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        layout: JointLayout,
        noise: SensorNoise,
        *,
        timestep_s: float | None = None,
        reach_s: float = REACH_S,
        unknown_friction: bool = False,
        offsets: ForceOffsets | None = None,
        open_axes: Sequence[int] = (),
    ) -> None:
        self._noise, self._offsets = noise, offsets
        self._timestep_s = float(model.opt.timestep) if timestep_s is None else timestep_s
        self._spans = Spans.at(self._timestep_s, reach_s)
        self._n_v, self._layout, self._joint_dof = model.nv, layout, layout.joint_dof
        self._sensors: SensorErrors | None = None
        rubs = unknown_friction or bool(np.any(model.dof_frictionloss > 0.0))
        self._stick_slip = StickSlip(model, layout, noise, self._timestep_s) if rubs else None
        self._before: tuple[FloatArray, ...] = ()
        n_joints = len(self._joint_dof)
        self._velocity_std = layout.to_qvel(noise.state_std(n_joints)[6 + n_joints :])
        self._effort_std = self._by_dof(np.full((1, n_joints), noise.effort))[0]
        self._wrench_std = np.tile(noise.wrench_std(), model.nu // 6)
        self._open = np.zeros(model.nu, dtype=np.bool_)
        self._open[list(open_axes)] = True

    @property
    def open_axes(self) -> IntArray:
        """Columns of the wrenches that no sensor measures, shape (m,)."""
        return np.flatnonzero(self._open)

    @property
    def look_ahead(self) -> int:
        """Samples after a block that bear upon it."""
        return self._spans.look_ahead

    def place(self, realisation: Realisation) -> None:
        """Take the parameters of the first of N models; lags are the same in all of them."""
        self._sensors = realisation.sensors
        if self._stick_slip is not None:
            self._stick_slip.place(realisation)

    def restart(self) -> None:
        """Forget what came before: the next block does not follow the last one."""
        self._before = ()

    def believe(self, block: ReplayBlock) -> BelievedBlock:
        """Judge the measurements of a block, in the light of those before and after."""
        n = len(block)
        parts: list[tuple[FloatArray, ...]] = [(block.qpos[:-1], block.qvel[:-1], block.effort, block.wrench)]
        if self._before:
            parts.insert(0, self._before)
        first = sum(len(part[0]) for part in parts) - n
        self._before = tuple(np.vstack([part[i] for part in parts])[-self._spans.memory :] for i in range(4))
        if block.ahead is not None:
            parts.append((block.ahead.qpos[:-1], block.ahead.qvel[:-1], block.ahead.effort, block.ahead.wrench))
        qpos, qvel, effort, wrench = (np.vstack([part[i] for part in parts]) for i in range(4))
        if self._sensors is not None:
            effort = self._read_later(effort, self._sensors.effort_lag[0, 0])
            wrench = np.where(self._open, wrench, self._read_later(wrench, self._sensors.wrench_lag[0, 0]))
        own = slice(first, first + n)
        readings = effort[own], wrench[own]
        unloaded = is_unloaded(wrench, self._noise, self._timestep_s, self._offsets, self.open_axes)
        loaded = np.repeat(~unloaded, 6, axis=1).astype(np.float64)
        qpos, qvel, effort, wrench = self._corrected(qpos, qvel, effort, wrench)
        # What a lag does to the models is what `_read_later` does.
        rates = [slope(rows, own, self._spans) / self._timestep_s for rows in (effort, wrench)]
        wrench = wrench * loaded
        rubbing = Friction.none(n, len(self._joint_dof))
        if self._stick_slip is not None:
            reach = self._stick_slip.reach
            near = slice(max(0, first - reach), first + n + reach)
            rubbing = self._stick_slip.friction(qpos[near], qvel[near], effort[near], wrench[near])
            rubbing = rubbing.rows(first - near.start, n)
        loss = np.where(rubbing.sticks, UNLIMITED, 0.0)
        friction, friction_loss, sliding = (self._by_dof(rows) for rows in (rubbing.torque, loss, rubbing.sliding))
        spans = self._spans
        motion = Motion(
            position=qpos[own],
            velocity=level(qvel, own, spans),
            acceleration=slope(qvel, own, spans, self._velocity_std) / self._timestep_s,
            effort=level(effort, own, spans),
            wrench=level(wrench, own, spans) * loaded[own],
            effort_rate=slope(effort, own, spans, self._effort_std) / self._timestep_s,
            wrench_rate=slope(wrench, own, spans, self._wrench_std) / self._timestep_s * loaded[own],
            loaded=loaded[own],
            sliding=sliding,
        )
        return BelievedBlock(
            qpos=block.qpos,
            qvel=block.qvel,
            effort=readings[0],
            wrench=readings[1] * loaded[own],
            friction=friction,
            friction_loss=friction_loss,
            friction_variance=rubbing.variance,
            unknown=self._open & (loaded[own] > 0.0),
            motion=motion,
            readings=replace(
                motion,
                effort=effort[own],
                wrench=wrench[own],
                effort_rate=rates[0],
                wrench_rate=rates[1] * loaded[own],
            ),
        )

    def _read_later(self, rows: FloatArray, lag_s: float) -> FloatArray:
        """Rows as they are some time later, by the slope of the readings around each.

        Not on straight lines between readings: those average their noise, half a sample the most, and a lag that is
        not there would score better for it.
        """
        if lag_s == 0.0:
            return rows
        return np.asarray(rows + lag_s / self._timestep_s * slope(rows, slice(0, len(rows)), self._spans))

    def _by_dof(self, rows: FloatArray) -> FloatArray:
        """Columns of joints as columns of degrees of freedom, zero at the base."""
        out = np.zeros((len(rows), self._n_v))
        out[:, self._joint_dof] = rows
        return out

    def _corrected(
        self, qpos: FloatArray, qvel: FloatArray, effort: FloatArray, wrench: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Measurements without what the first of the models takes for errors of the sensors."""
        if self._sensors is None:
            return qpos, qvel, effort, wrench
        sensors = {name: values[0] for name, values in vars(self._sensors).items()}
        qpos, qvel, effort = qpos.copy(), qvel.copy(), effort.copy()
        if sensors["state_offset"].any():
            layout, shift = self._layout, np.tile(-sensors["state_offset"], (len(qpos), 1))
            correct_state(qpos, qvel, shift, layout.root_qpos, layout.root_dof, layout.joint_qpos, layout.joint_dof)
        effort[:, self._joint_dof] -= sensors["effort_offset"]
        effort[:, self._joint_dof] /= 1.0 + sensors["effort_gain"]
        return qpos, qvel, effort, (wrench - sensors["wrench_offset"]) / (1.0 + sensors["wrench_gain"])
