"""Robots without force sensors, from a walk to an answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import massid
from massid.errors import BadInputError
from massid.identify import IdentifyOptions
from massid.model.unknowns.spaces import mass_space
from massid.plant import without_wrenches
from massid.result import Result, Status
from massid.walk import Walk
from massid.walk.noise import PRESETS, Sensors
from tests.conftest import Pushed
from tests.pushed_robot import draw_truth, fly_about, make_robot, push_about
from tests.weighed import verdict_on, weigh_online

SHORT = IdentifyOptions(dwell_s=0.2)
ASKED = ("torso", "l_calf", "r_foot")


@pytest.fixture(scope="module")
def log() -> Pushed:
    """A stretch on the ground."""
    robot = make_robot()
    space = mass_space(robot, ASKED)
    truth = draw_truth(space, seed=1)
    return Pushed(robot, space, truth, push_about(robot, space, truth, seconds=0.62, amplitude=0.15))


@pytest.fixture(scope="module")
def blind(log: Pushed) -> tuple[Walk, Walk]:
    """It, and one in the air, where feet show their masses."""
    falls = fly_about(log.robot, log.space, log.truth, seconds=0.42, amplitude=0.15)
    return without_wrenches(log.walk), without_wrenches(replace(falls, source="falls"))


@pytest.fixture(scope="module")
def weighed(log: Pushed, blind: tuple[Walk, Walk]) -> Result:
    return massid.weigh(blind, log.robot, ASKED, options=SHORT, held_out=0.0)


def test_a_log_without_noise_is_solved_to_rounding(log: Pushed, weighed: Result) -> None:
    assert weighed.status is Status.CONVERGED
    assert np.linalg.norm(weighed.estimate - log.truth) < 1e-6


def test_what_was_not_measured_is_not_claimed(weighed: Result) -> None:
    assert weighed.validation is not None
    assert weighed.validation.weight is None
    said = " ".join(weighed.warnings)
    assert "the scale of all masses rests on the torques" in said
    assert "l_foot 100%, r_foot 100%" in said  # of the fall
    assert "the ground carried" not in said


def test_the_evidence_holds_what_the_ground_must_have_exerted(log: Pushed, weighed: Result) -> None:
    assert weighed.evidence is not None
    stands, falls = weighed.evidence.walks
    rows = slice(150, 500)
    np.testing.assert_allclose(
        stands.wrench[rows].sum(axis=1)[:, 2], log.walk.wrench[rows].sum(axis=1)[:, 2], rtol=1e-3
    )
    assert not falls.wrench.any()


def test_a_foot_that_never_leaves_the_ground_is_not_identifiable(pushed: Pushed) -> None:
    sensors = Sensors(PRESETS["white"], 8, pushed.walk.contact_bodies, np.random.default_rng(0))
    noisy = without_wrenches(sensors.measure(pushed.walk.between(200, 900)))
    verdict = verdict_on(noisy, pushed.robot, pushed.space, replace(SHORT, noise="white"))
    assert {"l_foot", "r_foot"} <= set(verdict.hidden)
    assert "torso" not in verdict.hidden


def test_a_stream_has_no_log_to_judge_feet_by(log: Pushed, blind: tuple[Walk, Walk]) -> None:
    with pytest.raises(BadInputError, match="`mode` must be offline or auto"):
        weigh_online(blind[0], log.robot, log.space, SHORT)
