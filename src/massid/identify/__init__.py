"""Offline and online identification from walks.

Nothing is imported until it is used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from massid.lazy import lazy_names

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

__getattr__ = lazy_names(__name__, _HOMES)
