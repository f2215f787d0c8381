"""What a robot of the lab does while it is logged: walk, march in a harness, wriggle on the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from lab.harness import Harness, hang, marching_control, plan_march
from lab.plant import Recorded, simulate, walking_control, wriggling_control
from massid.model.robot import Robot
from massid.model.unknowns.spaces import mass_space
from massid.plant import MassErrors
from massid.search.parameters import ParameterSpace
from massid.typing import FloatArray

LINKS = 7


class Setting(Protocol):
    """How long, and with which masses and motion."""

    @property
    def seconds(self) -> float:
        """Length of the log [s]."""

    @property
    def seed(self) -> int:
        """Of mass errors and motion."""


@dataclass(frozen=True)
class Short:
    """A setting."""

    seconds: float
    seed: int = 0


def draw(robot: Robot, seed: int) -> tuple[ParameterSpace, FloatArray]:
    """Seven links and their true masses."""
    moving = [link for link in robot.links if robot.welded_to(link) is None]
    links = robot.walking_links()
    if len(links) < LINKS:
        links = tuple(sorted(moving, key=robot.nominal_mass_kg, reverse=True)[:LINKS])
    space = mass_space(robot, links)
    norm = float(np.linalg.norm(space.nominal)) / 4.0
    errors = MassErrors(links, norm).draw(robot, np.random.default_rng(seed)).error_kg
    return space, space.nominal + np.array([errors[link] for link in links])


def walk(
    robot: Robot, setting: Setting, walker_robot: Robot | None = None
) -> tuple[Recorded, str, ParameterSpace, FloatArray]:
    """Let a robot walk."""
    space, truth = draw(robot, setting.seed)
    control, start, feet = walking_control(robot, setting.seed, walker_robot)
    recorded = simulate(robot, space, truth, control, start, setting.seconds, feet)
    return recorded, "fell" if recorded.fell else "walked", space, truth


def wriggle(
    robot: Robot, setting: Setting, stiffness: float = 40.0, amplitude: float = 0.5
) -> tuple[Recorded, str, ParameterSpace, FloatArray]:
    """Let a robot wriggle on the floor, in contact with whatever touches it."""
    space, truth = draw(robot, setting.seed)
    control, start = wriggling_control(robot, setting.seed, stiffness, amplitude)
    return simulate(robot, space, truth, control, start, setting.seconds), "wriggled on the floor", space, truth


def march(robot: Robot, feet: tuple[str, str], setting: Setting) -> tuple[Recorded, str, ParameterSpace, FloatArray]:
    """Let a robot march on the spot in an instrumented harness, with its own motors."""
    space, truth = draw(robot, setting.seed)
    plan = plan_march(robot, feet)
    control, start = marching_control(robot, plan, setting.seed), hang(robot, plan, feet)
    recorded = simulate(robot, space, truth, control, start, setting.seconds, feet, support=Harness(robot))
    return recorded, "marched in a harness", space, truth
