from __future__ import annotations

from dataclasses import dataclass

import pytest

from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray
from massid.walk import Walk
from tests.pushed_robot import LINKS, draw_truth, make_robot, push_about


@dataclass(frozen=True)
class Pushed:
    """A log of a small biped together with what only tests may know."""

    robot: Robot
    space: ParameterSpace
    truth: FloatArray
    walk: Walk


@pytest.fixture(scope="session")
def pushed() -> Pushed:
    robot = make_robot()
    space = mass_space(robot, LINKS)
    truth = draw_truth(space, seed=3)
    return Pushed(robot, space, truth, push_about(robot, space, truth, seconds=1.6))
