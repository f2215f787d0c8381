"""A verdict and a fit that disagree: what the log was foreseen to reveal, and the fit left unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite

from massid.result.excitation import LARGEST_DEVIATION
from massid.result.posterior import INTERVAL_95
from massid.result.verdict import Motion, Verdict

LONGEST_S = 60.0
"""A log that would have to be longer is not recommended: sensors' offsets drift."""


def disagreement(
    verdict: Verdict, unforeseen: Sequence[str], std_kg: Mapping[str, float], contradicted: bool, log_s: float
) -> tuple[str, ...]:
    """Say why, one line each: not for lack of motion.

    Args:
        verdict: made before the fit.
        unforeseen: links, and names of other quantities, that it foresaw to be known and that are not.
        std_kg: standard deviation that the fit leaves each link [kg].
        contradicted: the windows of the log contradict each other.
        log_s: length of what was fitted [s].
    """
    if not unforeseen:
        return ()
    named = ", ".join(unforeseen)
    if contradicted:
        return (
            f"the motion would reveal {named}, but windows that contradict each other make the intervals too wide to "
            "call any of it known: check the model, the torque and force channels and `noise`, not the motion.",
        )
    foreseen = dict(zip(verdict.links, verdict.std.tolist(), strict=True))
    scale = dict(zip(verdict.links, verdict.space.scale.tolist(), strict=True))
    return tuple(
        f"{link} was foreseen to be known to +-{INTERVAL_95 * foreseen[link]:.2g} kg (95 %), but the fit leaves it "
        f"{_left(std_kg[link])}: "
        f"{_remedy(verdict, log_s * (std_kg[link] / (LARGEST_DEVIATION * scale[link])) ** 2)}."
        for link in unforeseen
    )


def _left(std_kg: float) -> str:
    return f"+-{INTERVAL_95 * std_kg:.2g} kg, too much to call it known" if isfinite(std_kg) else "unknown"


def _remedy(verdict: Verdict, enough_s: float) -> str:
    """What would help, where more of the same motion makes deviations smaller as the root of its length."""
    if verdict.facts.motion is not Motion.MOVING:
        return "more motion is needed"
    if enough_s <= LONGEST_S:
        return f"{enough_s:.2g} s of the same motion would do"
    return "more of the same motion would hardly help; larger and faster motion does, or see the warnings"
