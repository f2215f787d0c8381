from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from massid.identify import IdentifyOptions
from massid.model.robot import Robot
from massid.result.result import Result, Uncertainty
from massid.score import Score, Truth, score
from massid.walk import Walk
from massid.walk.noise import PRESETS
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


@pytest.fixture(scope="session")
def noisy(offline: Story) -> Story:
    """The replayed log as if it had had noise: every pass with intervals, which narrow by a half each time."""
    n = len(offline.result.space)
    windows = tuple(replace(one, std=np.full(n, 0.1 * 0.5**k)) for k, one in enumerate(offline.result.windows))
    covariance = np.diag(windows[-1].std ** 2)
    uncertainty = Uncertainty(PRESETS["white"], covariance, 1.0, 1.0, 0.3, (), np.zeros(0), np.zeros(0))
    return replace(offline, result=replace(offline.result, windows=windows, uncertainty=uncertainty))
