"""Stretches of a walk in the layout of an identification model: measured states and inputs, sample by sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from massid.log.walk import Sample, Segment, Walk
from massid.robot import JointLayout
from massid.typing import FloatArray


@dataclass(frozen=True)
class ReplayBlock:
    """Measurements of n steps: n inputs and the n + 1 states around them.

    Attributes:
        qpos: measured positions, shape (n + 1, nq).
        qvel: measured velocities, shape (n + 1, nv).
        effort: measured joint torques as generalised forces, zero at the base, shape (n, nv) [N m or N].
        wrench: measured contact wrenches in the bodies' frames, six columns per contact body, shape (n, 6 n_c).
    """

    qpos: FloatArray
    qvel: FloatArray
    effort: FloatArray
    wrench: FloatArray

    def __len__(self) -> int:
        return len(self.effort)


def replay_block(walk: Walk, layout: JointLayout, segment: Segment) -> ReplayBlock:
    """Cut samples start .. stop - 1 of a walk, whose joints are in the model's order, into one block of steps."""
    states = slice(segment.start, segment.stop)
    inputs = slice(segment.start, segment.stop - 1)
    effort = np.zeros((len(segment) - 1, walk.qvel.shape[1]))
    effort[:, layout.joint_dof] = walk.effort[inputs]
    return ReplayBlock(
        qpos=layout.to_qpos(walk.qpos[states]),
        qvel=layout.to_qvel(walk.qvel[states]),
        effort=effort,
        wrench=walk.wrench[inputs].reshape(len(effort), -1),
    )


class SampleBuffer:
    """Collects streamed samples into blocks; its size is all the memory that online identification needs.

    Args:
        layout: the model's addresses; the samples' joints are in the model's order.
        n_joints: number of one-axis joints.
        n_contacts: number of contact bodies.
        capacity: samples it holds.
    """

    def __init__(self, layout: JointLayout, n_joints: int, n_contacts: int, capacity: int) -> None:
        self._layout = layout
        self._qpos = np.zeros((capacity, 7 + n_joints))
        self._qvel = np.zeros((capacity, 6 + n_joints))
        self._effort = np.zeros((capacity, 6 + n_joints))
        self._wrench = np.zeros((capacity, 6 * n_contacts))
        self._count = 0

    @property
    def n_steps(self) -> int:
        """Steps between the samples held."""
        return max(0, self._count - 1)

    def append(self, sample: Sample) -> None:
        """Add one sample."""
        k = self._count
        self._qpos[k] = self._layout.to_qpos(sample.qpos)
        self._qvel[k] = self._layout.to_qvel(sample.qvel)
        self._effort[k, self._layout.joint_dof] = sample.effort
        self._wrench[k] = sample.wrench.ravel()
        self._count += 1

    def block(self) -> ReplayBlock:
        """All samples held, as steps; valid until the next call of any method."""
        n = self._count
        return ReplayBlock(self._qpos[:n], self._qvel[:n], self._effort[: n - 1], self._wrench[: n - 1])

    def keep_last(self) -> None:
        """Drop all samples but the last, with which the next block begins."""
        for rows in (self._qpos, self._qvel, self._effort, self._wrench):
            rows[0] = rows[self._count - 1]
        self._count = 1

    def clear(self) -> None:
        """Drop all samples."""
        self._count = 0


def split(segment: Segment, n_steps: int) -> Iterator[Segment]:
    """Split a window into consecutive blocks of at most n_steps steps that share their border samples."""
    for start in range(segment.start, segment.stop - 1, n_steps):
        yield Segment(start, min(start + n_steps, segment.stop - 1) + 1)
