"""Stretches of a walk in the layout of an identification model: measured states and inputs, sample by sample."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from massid.log.walk import Segment, Walk
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


def split(segment: Segment, n_steps: int) -> Iterator[Segment]:
    """Split a window into consecutive blocks of at most n_steps steps that share their border samples."""
    for start in range(segment.start, segment.stop - 1, n_steps):
        yield Segment(start, min(start + n_steps, segment.stop - 1) + 1)
