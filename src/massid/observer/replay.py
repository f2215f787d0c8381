"""Stretches of a walk in the layout of an identification model: measured states and inputs, sample by sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from massid.model.layout import JointLayout
from massid.typing import FloatArray
from massid.walk import Sample, Segment, Walk

BLOCK_STEPS = 50
"""Samples that are handed to a bank at a time."""


@dataclass(frozen=True)
class ReplayBlock:
    """Measurements of n steps: n inputs and the n + 1 states around them.

    Attributes:
        qpos: measured positions, shape (n + 1, nq).
        qvel: measured velocities, shape (n + 1, nv).
        effort: measured joint torques as generalised forces, zero at the base, shape (n, nv) [N m or N].
        wrench: measured contact wrenches in the bodies' frames, six columns per contact body, shape (n, 6 n_c).
        ahead: what was measured after the block, as far as it is known; nothing steps through it.
    """

    qpos: FloatArray
    qvel: FloatArray
    effort: FloatArray
    wrench: FloatArray
    ahead: ReplayBlock | None = None

    def __len__(self) -> int:
        return len(self.effort)

    def generalised_force(self, k: int) -> FloatArray:
        """Everything but the wrenches that acts in step k, shape (nv,)."""
        return np.asarray(self.effort[k])


def replay_block(walk: Walk, layout: JointLayout, segment: Segment, ahead: Segment | None = None) -> ReplayBlock:
    """Cut samples start .. stop - 1 of a walk, whose joints are in the model's order, into one block of steps.

    Args:
        walk: the walk.
        layout: addresses in the model.
        segment: what to cut out.
        ahead: what follows it, if it is to be known.
    """
    states = slice(segment.start, segment.stop)
    inputs = slice(segment.start, segment.stop - 1)
    effort = np.zeros((len(segment) - 1, walk.qvel.shape[1]))
    effort[:, layout.joint_dof] = walk.effort[inputs]
    return ReplayBlock(
        qpos=layout.to_qpos(walk.qpos[states]),
        qvel=layout.to_qvel(walk.qvel[states]),
        effort=effort,
        wrench=walk.wrench[inputs].reshape(len(effort), -1),
        ahead=None if ahead is None or len(ahead) < 2 else replay_block(walk, layout, ahead),
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

    def block(self, n_steps: int) -> ReplayBlock:
        """The first steps, with the rest of what is held ahead of them; valid until the next call of any method."""
        rest = self._block(n_steps, self._count - 1) if self._count - 1 > n_steps else None
        return replace(self._block(0, n_steps), ahead=rest)

    def drop(self, n_steps: int) -> None:
        """Drop the first steps; the next block begins with the sample in which they ended."""
        kept = self._count - n_steps
        for rows in (self._qpos, self._qvel, self._effort, self._wrench):
            rows[:kept] = rows[n_steps : self._count].copy()
        self._count = kept

    def _block(self, first: int, last: int) -> ReplayBlock:
        states, inputs = slice(first, last + 1), slice(first, last)
        return ReplayBlock(self._qpos[states], self._qvel[states], self._effort[inputs], self._wrench[inputs])

    def clear(self) -> None:
        """Drop all samples."""
        self._count = 0


def split(segment: Segment, n_steps: int) -> Iterator[Segment]:
    """Split a window into consecutive blocks of at most n_steps steps that share their border samples."""
    for start in range(segment.start, segment.stop - 1, n_steps):
        yield Segment(start, min(start + n_steps, segment.stop - 1) + 1)
