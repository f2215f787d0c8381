"""Offline and online identification from walks.

Nothing is imported until it is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from massid.identify.offline import identify_offline
    from massid.identify.online import OnlineIdentifier, identify_online
    from massid.identify.options import IdentifyOptions

_HOMES = {
    "IdentifyOptions": "options",
    "OnlineIdentifier": "online",
    "identify_offline": "offline",
    "identify_online": "online",
}

__all__ = ["IdentifyOptions", "OnlineIdentifier", "identify_offline", "identify_online"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
