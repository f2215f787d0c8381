"""A payload in one of several logs is found, and what carries it; the same robot on another day is not doubted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from massid.audit import differing_masses, prepare_walks
from massid.identify import IdentifyOptions
from massid.model.robot import Robot
from massid.result import Status
from massid.walk import Walk
from massid.walk.noise import PRESETS, NoisePreset, Sensors
from massid.weighing import weigh
from tests.conftest import Pushed
from tests.pushed_robot import push_about


@pytest.fixture(scope="module")
def days(pushed: Pushed) -> dict[str, Walk]:
    """Three logs: the same robot twice, and with 2 kg more on one shank."""
    loaded = pushed.truth.copy()
    loaded[pushed.space.names.index("mass/r_calf")] += 2.0
    walks = {
        "monday": pushed.walk,
        "tuesday": push_about(pushed.robot, pushed.space, pushed.truth, 1.6, seed=1),
        "loaded": push_about(pushed.robot, pushed.space, loaded, 1.6, seed=2),
    }
    return {name: replace(walk, source=name) for name, walk in walks.items()}


def through(robot: Robot, walk: Walk, noise: NoisePreset, seed: int) -> Walk:
    if noise == "clean":
        return walk
    sensors = Sensors(PRESETS[noise], len(robot.joint_names), walk.contact_bodies, np.random.default_rng(seed))
    return sensors.measure(walk)


@pytest.mark.parametrize("noise", ["clean", "realistic"])
def test_a_payload_in_one_of_the_logs_is_found_and_nothing_else(
    pushed: Pushed, days: dict[str, Walk], noise: NoisePreset
) -> None:
    walks = [through(pushed.robot, walk, noise, seed) for seed, walk in enumerate(days.values())]
    said = differing_masses(prepare_walks(walks, pushed.robot))
    assert [line.split(" are of")[0] for line in said] == ["monday and loaded", "tuesday and loaded"]
    for line in said:
        assert "kg heavier in loaded" in line
        assert "identify them one at a time" in line
    if noise == "clean":
        assert all("r_calf, or what it carries, is 2 +-" in line for line in said)


def test_logs_of_different_masses_never_end_well(pushed: Pushed, days: dict[str, Walk]) -> None:
    """A log without noise may be solved before the second has been looked at."""
    options = IdentifyOptions(dwell_s=0.2)
    links = ["torso", "r_calf"]
    both = weigh([days["monday"], days["loaded"]], pushed.robot, links, options=options, checks=False)
    assert both.status is Status.CONTRADICTED
    assert any("are of robots with different masses" in line for line in both.warnings)
    alone = weigh([days["monday"], days["tuesday"]], pushed.robot, links, options=options, checks=False)
    assert not any("different masses" in line for line in alone.warnings)
