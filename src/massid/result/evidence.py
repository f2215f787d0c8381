"""What a result was found from: kept with it, so that it can be saved, drawn and checked by others."""

from __future__ import annotations

from dataclasses import dataclass

from massid.model.robot import Robot
from massid.walk import Walk


@dataclass(frozen=True)
class Evidence:
    """Robot and logs of a result.

    Attributes:
        robot: with nominal masses, as the logs fit it: joints that they do not show are held still.
        complete: with nominal masses, as the model file has it.
        walks: the whole logs, checked and in the robot's order.
        fitted: the parts that masses were found from.
        held: the parts that were not fitted; None where it would have been too short.
    """

    robot: Robot
    complete: Robot
    walks: tuple[Walk, ...]
    fitted: tuple[Walk, ...]
    held: tuple[Walk | None, ...]
