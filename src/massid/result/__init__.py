"""What an identification found: the answer as data, with its uncertainty, in memory and on disk.

Nothing is imported until it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from massid.result.result import Result, Status, Uncertainty, WindowResult

_HOMES = {"Result": "result", "Status": "result", "Uncertainty": "result", "WindowResult": "result"}

__all__ = ["Result", "Status", "Uncertainty", "WindowResult"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
