"""A bank of identification models of one robot (Eq. 22-23), run in parallel through a recorded walk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import mujoco
import numpy as np

from massid.model.realisation import SensorErrors
from massid.model.robot import Robot
from massid.observer.engine import BatchEngine
from massid.observer.injection import InertiaShapedInjection, OutputInjection, Trajectory
from massid.observer.inputs import BelievedBlock
from massid.observer.kernels import correct_state, state_difference
from massid.observer.replay import BLOCK_STEPS, ReplayBlock, replay_block, split
from massid.search.bank import Bank, OutputErrors
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray, IntArray
from massid.walk import Segment, Walk


class RobotBank(Bank[ReplayBlock]):
    """N copies of a robot with link masses of their own, driven by measured torques and wrenches.

    The output is the whole state: y = (q, qd).

    Args:
        robot: the robot with nominal masses.
        space: what the coordinates of a point mean.
        contact_bodies: bodies whose wrench was measured, in the order of the blocks' columns.
        n_models: size of the bank N.
        injection: how the models are pulled towards the measurement; default `InertiaShapedInjection`.
        timestep_s: sample period of the walk; default the time step of the model [s].
        substeps: steps of the models in a period, through which the inputs are held.
        n_threads: worker threads; 0 for one per processor.
        model: identification model; default that of the robot. It is not written to.
    """

    def __init__(
        self,
        robot: Robot,
        space: ParameterSpace,
        contact_bodies: Sequence[str],
        n_models: int = 24,
        injection: OutputInjection | None = None,
        timestep_s: float | None = None,
        substeps: int = 1,
        n_threads: int = 0,
        model: mujoco.MjModel | None = None,
    ) -> None:
        self.robot = robot
        self.space = space
        if model is None:
            model = robot.identification_model(contact_bodies)
            if timestep_s is not None:
                model.opt.timestep = timestep_s / substeps
        self._timestep_s = float(model.opt.timestep) * substeps
        self._substeps = substeps
        self._engine = BatchEngine(model, n_models, n_threads)
        self._injection: OutputInjection = InertiaShapedInjection(model) if injection is None else injection
        self._innovation = np.zeros((n_models, 2 * model.nv))
        self._injected = np.zeros((n_models, model.nv))
        self._contact_bodies = tuple(contact_bodies)
        self._sensors: SensorErrors | None = None
        self._more_friction: FloatArray | None = None
        self._points: FloatArray = np.repeat(space.nominal[None], n_models, axis=0)
        self._points_before = self._points

    @property
    def n_models(self) -> int:
        """Number of models N."""
        return self._engine.n_models

    @property
    def timestep_s(self) -> float:
        """Period of the output errors [s]."""
        return self._timestep_s

    def place(self, points: FloatArray) -> None:
        """Write the parameters of each model; points has shape (n_models, n_p)."""
        self._points_before, self._points = self._points, points.copy()
        realisation = self.robot.realise(self.space, points, self._contact_bodies)
        self._engine.write(realisation.without_friction() if self._injection.judges_friction else realisation)
        self._injection.place(realisation)
        self._sensors = realisation.sensors
        losses = realisation.friction_loss
        self._more_friction = None if losses is None else losses - losses[0]

    def restart(self, block: ReplayBlock, *, follows: bool = False) -> None:
        """Set every model to the first measured state of the block.

        Args:
            block: what comes next.
            follows: whether it follows the block before without a gap; what was measured there then still tells of the
                inputs of this one.
        """
        engine, layout = self._engine, self.robot.layout
        engine.restart(block.qpos[0], block.qvel[0])
        if self._sensors is not None and self._sensors.state_offset.any():
            addresses = (layout.root_qpos, layout.root_dof, layout.joint_qpos, layout.joint_dof)
            correct_state(engine.qpos, engine.qvel, -self._sensors.state_offset, *addresses)
        self._injection.restart(follows=follows)
        self._innovation[:] = 0.0

    @property
    def carries_belief(self) -> bool:
        """Whether windows follow each other by `carry_on` instead of `restart`."""
        return self._injection.carries_belief

    @property
    def look_ahead(self) -> int:
        """Samples after a block that bear upon it."""
        return self._injection.look_ahead

    def carry_on(self, samples: IntArray) -> None:
        """Go on from the window before with the parameters that were placed since, instead of restarting.

        The models of that window show how the state depends on the parameters. Each model starts where it would stand,
        had it had its new parameters all along; so nothing that the state remembers of the past is lost.

        Args:
            samples: rows that were samples around the centre, row 0, and did not diverge.
        """
        engine, layout = self._engine, self.robot.layout
        addresses = (layout.root_qpos, layout.root_dof, layout.joint_qpos, layout.joint_dof)
        n_sampled = self.space.n_sampled
        to_centre = np.zeros_like(self._innovation)
        state_difference(engine.qpos, engine.qvel, engine.qpos[0].copy(), engine.qvel[0].copy(), *addresses, to_centre)
        offsets = (self._points_before[samples] - self._points_before[0])[:, :n_sampled] / self.space.scale[:n_sampled]
        by_parameter, *_ = np.linalg.lstsq(offsets, -to_centre[samples])
        change = self._points - self._points_before[0]
        shift = (change[:, :n_sampled] / self.space.scale[:n_sampled]) @ by_parameter
        shift += self._injection.state_shift(change[:, n_sampled:])
        engine.qpos[:], engine.qvel[:] = engine.qpos[0], engine.qvel[0]
        correct_state(engine.qpos, engine.qvel, shift, *addresses)
        self._compare(*self._last_measured)

    def advance(self, block: ReplayBlock) -> OutputErrors:
        """Run every model through the block; see `OutputErrors`."""
        engine, layout = self._engine, self.robot.layout
        gains = self._injection.gains(block)
        inputs = block if gains.inputs is None else gains.inputs
        innovation, injected = self._innovation, self._injected
        addresses = (layout.root_qpos, layout.root_dof, layout.joint_qpos, layout.joint_dof)
        self._last_measured = (block.qpos[-1].copy(), block.qvel[-1].copy())
        errors = np.empty((len(block), *innovation.shape))
        position = np.empty((len(block), engine.qpos.shape[1]))
        velocity, after = np.empty((2, len(block), engine.qvel.shape[1]))
        with engine.quiet(), np.errstate(invalid="ignore", over="ignore"):
            for k in range(len(block)):
                if gains.state is not None:
                    correct_state(engine.qpos, engine.qvel, innovation @ gains.state[k].T, *addresses)
                self._apply_inputs(inputs, k)
                if gains.force is not None:
                    np.matmul(innovation, gains.force[k].T, out=injected)
                    np.add(engine.force, injected, out=engine.force)
                position[k], velocity[k] = engine.qpos[0], engine.qvel[0]
                engine.step(self._substeps)
                after[k] = engine.qvel[0]
                self._compare(block.qpos[k + 1], block.qvel[k + 1])
                np.negative(innovation, out=errors[k])
            if gains.whitener.ndim == 1:
                errors *= gains.whitener
            else:
                errors = errors @ gains.whitener.transpose(0, 2, 1)
        shown = self._injection.shown(gains, Trajectory(position, velocity, (after - velocity) / self._timestep_s))
        return OutputErrors(
            values=errors.transpose(1, 0, 2),
            diverged=engine.diverged(),
            tangents=None if gains.tangents is None else gains.tangents.transpose(1, 0, 2),
            shown=shown,
            explained=gains.explained,
        )

    def replay(
        self, walk: Walk, segment: Segment, *, stop: int | None = None, restart: bool = True
    ) -> Iterator[tuple[Segment, OutputErrors]]:
        """Run every model through a stretch of a walk, block by block.

        Args:
            walk: with its joints in the robot's order.
            segment: samples start .. stop - 1 of it, between which there is no gap.
            stop: end of the samples that may bear upon the last blocks; default the end of the segment.
            restart: whether the models start at the first measurement, instead of where they are.

        Yields:
            The samples of each block, and the output errors at the end of its steps.
        """
        stop = segment.stop if stop is None else stop
        for part in split(segment, BLOCK_STEPS):
            ahead = Segment(part.stop - 1, min(part.stop + self.look_ahead, stop))
            block = replay_block(walk, self.robot.layout, part, ahead)
            if restart and part.start == segment.start:
                self.restart(block)
            yield part, self.advance(block)

    def _compare(self, qpos: FloatArray, qvel: FloatArray) -> None:
        """Write every model's innovation: what is measured, less what its sensors read too much, minus its state."""
        engine, layout = self._engine, self.robot.layout
        addresses = (layout.root_qpos, layout.root_dof, layout.joint_qpos, layout.joint_dof)
        state_difference(engine.qpos, engine.qvel, qpos, qvel, *addresses, self._innovation)
        if self._sensors is not None:
            self._innovation -= self._sensors.state_offset

    def _apply_inputs(self, inputs: ReplayBlock, k: int) -> None:
        """Give the models the inputs of a step, with the sensors' errors taken out."""
        engine, dof, sensors = self._engine, self.robot.layout.joint_dof, self._sensors
        engine.force[:] = inputs.effort[k]
        engine.wrench[:] = inputs.wrench[k]
        if sensors is not None:
            engine.force[:, dof] = (engine.force[:, dof] - sensors.effort_offset) / (1.0 + sensors.effort_gain)
            engine.wrench[:] = (engine.wrench - sensors.wrench_offset) / (1.0 + sensors.wrench_gain)
        if isinstance(inputs, BelievedBlock):
            engine.force[:] += inputs.friction[k]
            engine.set_friction_loss(inputs.friction_loss[k])
            if self._more_friction is not None:  # than the first model has, whose friction the belief tells
                engine.force[:] += self._more_friction * inputs.motion.sliding[k]
            engine.wrench[:] *= inputs.motion.loaded[k]
