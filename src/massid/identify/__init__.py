"""Offline and online identification from walks."""

from massid.identify.offline import identify_offline
from massid.identify.online import OnlineIdentifier, identify_online
from massid.identify.options import IdentifyOptions

__all__ = [
    "IdentifyOptions",
    "OnlineIdentifier",
    "identify_offline",
    "identify_online",
]
