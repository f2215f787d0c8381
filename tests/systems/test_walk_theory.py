"""Section IV on the humanoid: models of the bank on the walk that comes with massid, and a mass that drifts."""

from __future__ import annotations

import numpy as np
import pytest

from massid.assets import resolve_model, sample_walk
from massid.log import read_walk
from massid.model.robot import Robot
from massid.paper.walk_drift import LINK, RATE_KG_S, FillingAgent
from massid.paper.walk_theory import WalkTheory
from massid.plant import make_environment, truth_path
from massid.score import Truth
from massid.typing import FloatArray


@pytest.fixture(scope="module")
def theory() -> WalkTheory:
    log = sample_walk()
    robot = Robot.load(resolve_model("atlas"))
    truth, links = Truth.load(truth_path(log)), robot.walking_links()
    return WalkTheory(robot, robot.align(read_walk(log)), np.array([truth.mass_kg[link] for link in links]), links)


@pytest.mark.parametrize(
    "statement",
    [
        "unique_minimiser",
        "no_unique_minimiser",
        "theorem_1",
        "theorem_1_disturbed",
        "continuity",
        "quadratic_mu",
    ],
)
def test_the_papers_statements_on_a_walk(theory: WalkTheory, statement: str) -> None:
    outcome = getattr(theory, statement)()
    assert outcome.system == "walk"
    assert outcome.holds, outcome.measured


def test_nothing_pulls_the_masses_of_a_falling_robot(theory: WalkTheory) -> None:
    """Without information a second-order step leaves the initial guess alone."""
    falling = theory.windows().only(theory.falling())
    quadratic = falling.quadratic(falling.space.nominal)
    assert np.abs(quadratic.gradient).max() < 1e-20
    assert np.abs(quadratic.curvature).max() < 1e-20


def test_a_filling_robot_grows_heavier() -> None:
    robot = Robot.load(resolve_model("atlas"))
    environment = make_environment(robot)
    timestep = environment.reset()

    def stand(timestep: object) -> FloatArray:
        return np.zeros(environment.action_spec().shape)

    agent = FillingAgent(stand, environment, robot, LINK, RATE_KG_S)
    for _ in range(20):
        timestep = environment.step(agent(timestep))
    filled_s = environment.physics.data.time - environment.control_timestep()
    model = environment.physics.model.ptr
    prefix = environment.task.humanoid.mjcf_model.model
    body = model.body(f"{prefix}/{LINK}")
    nominal = robot.model.body(LINK)
    assert body.mass[0] == pytest.approx(nominal.mass[0] + RATE_KG_S * filled_s, rel=1e-12)
    np.testing.assert_allclose(body.inertia / nominal.inertia, body.mass[0] / nominal.mass[0], rtol=1e-9)
    environment.close()
