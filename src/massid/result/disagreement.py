"""A verdict and a fit that disagree: what the log was foreseen to reveal, and the fit left unknown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from massid.result.posterior import INTERVAL_95
from massid.result.verdict import Motion, Verdict


def disagreement(
    verdict: Verdict, unforeseen: Sequence[str], std_kg: Mapping[str, float], contradicted: bool
) -> tuple[str, ...]:
    """Say why, one line each: not for lack of motion.

    Args:
        verdict: made before the fit.
        unforeseen: links, and names of other quantities, that it foresaw to be known and that are not.
        std_kg: standard deviation that the fit leaves each link [kg]; empty for a log without noise.
        contradicted: the windows of the log contradict each other.
    """
    if not unforeseen:
        return ()
    named = ", ".join(unforeseen)
    if contradicted:
        return (
            f"the motion would reveal {named}, but windows that contradict each other make the intervals too wide to "
            "call any of it known: check the model, the torque and force channels and `noise`, not the motion.",
        )
    remedy = "take a longer walk" if verdict.facts.motion is Motion.MOVING else "more motion is needed"
    if not std_kg:
        return (f"the motion would reveal {named}, but the windows that were fitted do not: {remedy}.",)
    foreseen = dict(zip(verdict.links, verdict.std.tolist(), strict=True))
    return tuple(
        f"{link} was foreseen to be known to +-{INTERVAL_95 * foreseen[link]:.2g} kg (95 %), but the fit leaves it "
        f"+-{INTERVAL_95 * std_kg[link]:.2g} kg, too much to call it known: {remedy}."
        for link in unforeseen
    )
