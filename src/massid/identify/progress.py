"""How long work tells where it stands, and is asked to end early: callbacks, given by whoever calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[float, str], None]
"""Called with the fraction done, 0 to 1, and a few words."""


def silent(fraction: float, what: str) -> None:
    """Say nothing."""


def never() -> bool:
    """Do not stop."""
    return False


def part_of(progress: Progress, start: float, end: float) -> Progress:
    """Progress of a part that takes the whole from one fraction to another."""

    def tell(fraction: float, what: str) -> None:
        progress(start + (end - start) * fraction, what)

    return tell
