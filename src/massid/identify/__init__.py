"""Offline and online identification from walks."""

from massid.identify.offline import identify_offline
from massid.identify.online import OnlineIdentifier, identify_online
from massid.identify.options import IdentifyOptions
from massid.identify.result import Result, Status, WindowResult

__all__ = [
    "IdentifyOptions",
    "OnlineIdentifier",
    "Result",
    "Status",
    "WindowResult",
    "identify_offline",
    "identify_online",
]
