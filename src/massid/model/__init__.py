"""The robot: its MJCF, names and masses, what is unknown of it, and what points of Theta make of it.

Nothing is imported until it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from massid.model.robot import Robot

_HOMES = {"Robot": "robot"}

__all__ = ["Robot"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
