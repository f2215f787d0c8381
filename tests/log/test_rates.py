"""Topics of different rates, and joints that come seldom: what is thrown away, and what is not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from massid.log import load_topics, read_walk
from tests.log.samples import Foreign, smooth_samples

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
