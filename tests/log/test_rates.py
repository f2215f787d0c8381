"""Topics of different rates, and joints that come seldom: what is thrown away, and what is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massid.log import load_topics, read_walk
from tests.log.samples import JOINTS, START_NS, STEP_NS, Foreign, make_samples, smooth_samples

N = 400
SLOW = {"/odom": 20, "/contact/l_foot": 4}
"""Topics, and of how many samples they have one."""


def noisy_log(path: Path, slow: str, std: float = 0.02) -> Foreign:
    """Joints and attitudes that shake as sensors do."""
    log = Foreign(path, smooth_samples(N))
    rng = np.random.default_rng(1)
    for message in log.messages["/joint_states"]:
        message.position = message.position + 0.1 * std * rng.normal(size=len(message.position))
        message.velocity = message.velocity + std * rng.normal(size=len(message.velocity))
    log.drop(slow, [row for row in range(N) if row % SLOW[slow]])
    return log


@pytest.mark.parametrize("slow", SLOW)
def test_in_noise_the_slowest_clock_is_taken_and_faster_states_are_averaged(foreign: Any, slow: str) -> None:
    """None of the joints' samples is thrown away: what their noise leaves falls as that of a mean does."""
    samples, std = smooth_samples(N), 0.02
    walk = read_walk(noisy_log(foreign(1).path, slow, std).write())
    every = SLOW[slow]
    assert walk.timestep_s == pytest.approx(every * 1e-3)
    rows = np.arange(len(walk)) * every
    off = walk.qvel[1:-1, 6:] - samples.qvel[rows[1:-1], 6:]
    assert off.std() < 1.3 * std / np.sqrt(every)
    assert any("the slowest clock was taken, and states of" in line for line in walk.warnings)
    if slow != "/odom":  # attitudes are averaged as such
        np.testing.assert_allclose(np.linalg.norm(walk.qpos[:, 3:7], axis=1), 1.0, atol=1e-12)
        np.testing.assert_allclose(walk.qpos[2:-2, :7], samples.qpos[rows[2:-2], :7], atol=1e-4)


def test_every_sample_can_be_kept(foreign: Any, tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text("preset: massid\nrate: fastest\n")
    walk = read_walk(noisy_log(foreign(1).path, "/odom").write(), load_topics(tmp_path / "map.yaml"))
    assert walk.timestep_s == pytest.approx(1e-3)


def gripper(log: Foreign, every: int) -> None:
    """A publisher of one more joint, which seldom sends, on the same topic."""
    for row, message in reversed(list(enumerate(log.messages["/joint_states"]))):
        if row % every == 0:
            fields = {name: np.array([0.001 * row]) for name in ("position", "velocity", "effort")}
            more = log.make("sensor_msgs/msg/JointState", header=message.header, name=["gripper"], **fields)
            log.messages["/joint_states"].insert(row + 1, more)


@pytest.mark.parametrize("noise", ["clean", "noisy"])
def test_joints_that_come_seldom_are_left_out_or_interpolated_as_the_map_says(
    foreign: Any, tmp_path: Path, noise: str
) -> None:
    """They never set the clock."""
    log = (
        noisy_log(foreign(1).path, "/contact/l_foot")
        if noise == "noisy"
        else Foreign(foreign(1).path, smooth_samples(N))
    )
    gripper(log, every=20)
    path = log.write()
    left = read_walk(path)
    assert left.joint_names == JOINTS
    assert any("`joints: seldom: keep` in a topic map takes" in line for line in left.warnings)
    (tmp_path / "map.yaml").write_text("preset: massid\njoints: {seldom: keep}\n")
    kept = read_walk(path, load_topics(tmp_path / "map.yaml"))
    assert kept.joint_names == (*JOINTS, "gripper")
    assert kept.timestep_s == pytest.approx(left.timestep_s)
    rows = np.rint((kept.stamps_ns - smooth_samples(N).stamps[0]) / 1e6)
    np.testing.assert_allclose(kept.qvel[:, -1], 0.001 * rows, atol=1e-9)


def test_half_the_rate_is_resampled_and_said(foreign, tmp_path):
    log = foreign(40)
    log.drop("/odom", range(1, 40, 2))
    (tmp_path / "map.yaml").write_text("preset: massid\nrate: slowest\n")
    walk = read_walk(log.write(), load_topics(tmp_path / "map.yaml"))
    assert walk.timestep_s == 2e-3
    assert any("different rates (/odom 500 Hz, /joint_states 1000 Hz" in line for line in walk.warnings)
    rows = np.arange(0, len(walk) * 2, 2)
    samples = make_samples(40)
    # states at the slow topic's own stamps are not changed; inputs are the means over its period
    np.testing.assert_allclose(walk.qpos, samples.qpos[rows], rtol=0, atol=1e-12)
    np.testing.assert_allclose(walk.effort, 0.5 * (samples.effort[rows] + samples.effort[rows + 1]), atol=1e-9)


def test_a_slow_base_does_not_slow_the_joints_down(foreign):
    """50 Hz of a state estimator beside 1 kHz of the drives: nothing of the drives is thrown away."""
    samples = smooth_samples(200)
    log = Foreign(foreign(1).path, samples)
    log.drop("/odom", [row for row in range(200) if row % 20])
    walk = read_walk(log.write())
    assert walk.timestep_s == 1e-3
    n = len(walk)
    assert n >= 180
    np.testing.assert_array_equal(walk.qpos[:, 7:], samples.qpos[:n, 7:])
    np.testing.assert_allclose(walk.effort, samples.effort[:n], atol=1e-11)
    # a cubic over 20 ms of a motion of 10 rad/s: the fourth power of 0.2, over 384
    np.testing.assert_allclose(walk.qpos[:, :3], samples.qpos[:n, :3], atol=1e-5)


def test_stamps_of_another_clock_are_resampled(foreign):
    log = foreign(40)
    for row in range(40):
        log.set_stamp("/odom", row, START_NS + row * STEP_NS + 1)
    walk = read_walk(log.write())
    assert any("only 0 stamps are shared by all streams (samples: /odom 40" in line for line in walk.warnings)
    # one nanosecond of a millisecond: a millionth of the change from one sample to the next
    np.testing.assert_allclose(walk.effort, make_samples(40).effort[: len(walk)], atol=1e-3)
