from __future__ import annotations

from dataclasses import dataclass

import pytest

from massid.identify import IdentifyOptions
from massid.model.robot import Robot
from massid.result.result import Result
from massid.score import Score, Truth, score
from massid.walk import Walk
from tests.conftest import Pushed
from tests.weighed import weigh_offline, weigh_online


@dataclass(frozen=True)
class Story:
    """A log, what was found in it, and how wrong that is."""

    walk: Walk
    robot: Robot
    result: Result
    score: Score


def _story(pushed: Pushed, result: Result) -> Story:
    names = [parameter.target for parameter in pushed.space.parameters]
    truth = Truth(dict(zip(names, pushed.truth.tolist(), strict=True)))
    return Story(pushed.walk, pushed.robot, result, score(result, truth))


@pytest.fixture(scope="session")
def online(pushed: Pushed) -> Story:
    options = IdentifyOptions(dwell_s=0.3)
    return _story(pushed, weigh_online(pushed.walk, pushed.robot, pushed.space, options))


@pytest.fixture(scope="session")
def offline(pushed: Pushed) -> Story:
    options = IdentifyOptions(dwell_s=0.5, passes=2)
    return _story(pushed, weigh_offline(pushed.walk, pushed.robot, pushed.space, options))
