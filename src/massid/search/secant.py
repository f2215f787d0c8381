"""Steps that do not converge by themselves: what the last two say of each other (Anderson mixing of depth one)."""

from __future__ import annotations

from dataclasses import dataclass

from massid.search.quadratic import LocalQuadratic
from massid.typing import FloatArray

POOR = 0.5
"""Share of the last step's length from which on a step is taken for one of those that do not converge."""
SHARES = (-3.0, 0.75)
"""Least and largest weight of the step before: steps that creep reach at most four times as far, and those that swing
to and fro at least a quarter."""


@dataclass(frozen=True)
class Step:
    """From where, by how much, both of shape (n_p,)."""

    start: FloatArray
    offset: FloatArray


def mixed(last: Step, now: Step, quadratic: LocalQuadratic) -> FloatArray:
    """The step that two steps over the same windows suggest.

    Where steps shrink to less than half, that is the later one. Otherwise they are taken as a line on which the step
    vanishes somewhere, as of a secant: between their starts if they point at each other, and farther on if they point
    the same way (D. G. Anderson, J. ACM 12, 1965).

    Args:
        last: proposed in the pass before.
        now: proposed now.
        quadratic: in whose metric lengths are measured.

    Returns:
        Shape (n_p,).
    """
    change = now.offset - last.offset
    squared = float(change @ quadratic.curvature @ change)
    length, before = (float(one.offset @ quadratic.curvature @ one.offset) for one in (now, last))
    if squared <= 0.0 or length < POOR**2 * before:
        return now.offset
    share = min(max(float(now.offset @ quadratic.curvature @ change) / squared, SHARES[0]), SHARES[1])
    return now.offset - share * (now.start - last.start + change)
