"""Which motion would reveal masses that a log does not: from the physics of what is missing."""

from __future__ import annotations

from collections.abc import Sequence

from massid.judge.motion import neighbouring_joints
from massid.model.robot import Robot
from massid.result.disagreement import LONGEST_S
from massid.result.verdict import Motion, MotionFacts

_NAMED = 4
_ENOUGH_RAD = 0.1
"""Excursion (standard deviation) beyond which a joint is not said to move too little [rad]."""

_HELD = (
    "no measured contact carries the robot, yet it does not fall: log the wrench of what holds it (a gantry, a hand), "
    "or put the robot on its feet"
)
_STANDING = (
    "walk, or shift the weight from foot to foot and lift each foot: while the robot stands still, the split between "
    "links shows only in constant torques, which the torque sensors' offsets imitate"
)
_IN_THE_AIR = (
    "let the robot stand or walk on feet whose forces are measured: in free fall gravity loads no joint and no foot, "
    "so a mass shows only in the torque that accelerates it"
)


def advise(
    robot: Robot, facts: MotionFacts, links: Sequence[str], hidden: Sequence[str], enough_s: float | None
) -> tuple[str, ...]:
    """Say what would help.

    Args:
        robot: the robot.
        facts: what it did.
        links: the links asked for.
        hidden: those of them that the log does not reveal.
        enough_s: length of a log with the same motion that would do [s]; None if no length would.
    """
    if not hidden:
        return (_IN_THE_AIR,) if facts.motion is Motion.IN_THE_AIR else ()
    stiff = _stiff_joints(facts, neighbouring_joints(robot, hidden, links))
    match facts.motion:
        case Motion.HELD:
            return (_HELD,)
        case Motion.IN_THE_AIR:
            lines = [_IN_THE_AIR, *stiff]
        case Motion.STANDING:
            lines = [_STANDING, *stiff]
        case Motion.MOVING:
            lines = stiff or ["larger and faster motion of " + ", ".join(hidden)]
    if enough_s is not None and enough_s <= LONGEST_S:
        lines.append(f"more of the same motion: {enough_s:.3g} s would do")
    elif facts.motion is not Motion.IN_THE_AIR:
        lines.append("more of the same motion would hardly help: what is missing hides behind the sensors' offsets")
    return tuple(lines)


def _stiff_joints(facts: MotionFacts, joints: Sequence[str]) -> list[str]:
    """Name the joints that moved least."""
    stiff = sorted((facts.excursion_rad[name], name) for name in joints if facts.excursion_rad[name] < _ENOUGH_RAD)
    if not stiff:
        return []
    named = ", ".join(f"{name} ({size:.3f} rad rms)" for size, name in stiff[:_NAMED])
    return [f"move the joints beside these links, which hardly moved: {named}"]
