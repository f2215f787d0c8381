"""Streamed samples must become the blocks that are cut out of a recorded walk."""

from __future__ import annotations

import numpy as np
import pytest

from massid.observer.replay import ReplayBlock, SampleBuffer, replay_block
from massid.walk import Segment
from tests.conftest import Pushed


def _same(block: ReplayBlock | None, expected: ReplayBlock | None) -> None:
    assert (block is None) == (expected is None)
    if block is not None and expected is not None:
        for name in ("qpos", "qvel", "effort", "wrench"):
            np.testing.assert_array_equal(getattr(block, name), getattr(expected, name), err_msg=name)
        _same(block.ahead, expected.ahead)


@pytest.mark.parametrize("ahead", [0, 1, 7, 40])
def test_streamed_blocks_are_those_of_the_recorded_walk(ahead: int, pushed: Pushed) -> None:
    walk, layout, n_steps = pushed.walk, pushed.robot.layout, 20
    buffer = SampleBuffer(layout, len(walk.joint_names), len(walk.contact_bodies), n_steps + ahead + 1)
    start = 0
    for sample, _ in zip(walk.samples(), range(200), strict=False):
        buffer.append(sample)
        if buffer.n_steps == n_steps + ahead:
            last = start + n_steps
            _same(
                buffer.block(n_steps),
                replay_block(walk, layout, Segment(start, last + 1), Segment(last, last + ahead + 1)),
            )
            buffer.drop(n_steps)
            assert buffer.n_steps == ahead
            start = last
    assert start >= 140


def test_a_cleared_buffer_begins_anew(pushed: Pushed) -> None:
    walk, layout = pushed.walk, pushed.robot.layout
    samples = list(walk.samples())
    buffer = SampleBuffer(layout, len(walk.joint_names), len(walk.contact_bodies), 30)
    assert buffer.n_steps == 0
    for sample in samples[:25]:
        buffer.append(sample)
    buffer.clear()
    assert buffer.n_steps == 0
    for sample in samples[50:61]:
        buffer.append(sample)
    _same(buffer.block(10), replay_block(walk, layout, Segment(50, 61)))
