"""`massid.weigh` as most tests want it: all of a walk fitted, no verdict, no checks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from massid.identify import IdentifyOptions
from massid.model.robot import Robot
from massid.result import Result
from massid.result.verdict import Verdict
from massid.search.parameters import ParameterSpace
from massid.walk import Walk
from massid.weighing import Weighing, weigh


def weigh_all(
    walks: Walk | Sequence[Walk],
    robot: Robot,
    space: ParameterSpace,
    options: IdentifyOptions | None = None,
    mode: Literal["online", "offline"] = "offline",
) -> Result:
    """What `weigh` makes of walks when these parameters are unknown."""
    return weigh(walks, robot, (), unknowns=space.parameters, mode=mode, held_out=0.0, checks=False, options=options)


def weigh_offline(
    walks: Walk | Sequence[Walk], robot: Robot, space: ParameterSpace, options: IdentifyOptions | None = None
) -> Result:
    """Replayed."""
    return weigh_all(walks, robot, space, options, "offline")


def weigh_online(
    walks: Walk | Sequence[Walk], robot: Robot, space: ParameterSpace, options: IdentifyOptions | None = None
) -> Result:
    """Seen once."""
    return weigh_all(walks, robot, space, options, "online")


def verdict_on(walk: Walk, robot: Robot, space: ParameterSpace, options: IdentifyOptions | None = None) -> Verdict:
    """What is said of a walk before anything is fitted to it."""
    return Weighing.prepare(walk, robot, (), unknowns=space.parameters, held_out=0.0, options=options).foresee()
