"""The library names its options as Python does, in backticks; whoever types sees the flags of the command line."""

from __future__ import annotations

import re
from dataclasses import fields
from functools import cache

from massid.identify.options import IdentifyOptions
from massid.search.guided import SearchOptions

_NAMED = re.compile(r"`(?P<name>[a-z][a-z0-9_]*)(?:=(?P<value>[^`\s]+))?`")
_OF_COMMANDS = ("links", "model", "mode", "held_out", "topics", "unknown", "unknowns")


@cache
def _options() -> frozenset[str]:
    return frozenset([*_OF_COMMANDS, *(one.name for kind in (IdentifyOptions, SearchOptions) for one in fields(kind))])


def in_flags(text: str) -> str:
    """Write `dwell_s` and `mode=offline` as --dwell-s and --mode offline; other words in backticks stay."""

    def flag(match: re.Match[str]) -> str:
        if match["name"] not in _options():
            return match[0]
        name = "--" + match["name"].replace("_", "-")
        return name if match["value"] is None else f"{name} {match['value']}"

    return _NAMED.sub(flag, text)
