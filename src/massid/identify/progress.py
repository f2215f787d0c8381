"""How long work tells where it stands: a callback, drawn by whoever calls."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

Progress: TypeAlias = Callable[[float, str], None]
"""Called with the fraction done, 0 to 1, and a few words."""


def silent(fraction: float, what: str) -> None:
    """Say nothing."""
