from __future__ import annotations

from dataclasses import dataclass

import pytest

from massid.log.walk import Walk
from massid.parameters import ParameterSpace
from massid.robot import Robot
from massid.typing import FloatArray
from massid.unknowns import mass_space
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
