"""The library names its options as Python does, in backticks; whoever types sees the flags of the command line."""

from __future__ import annotations

import re

_NAMED = re.compile(r"`(?P<name>[a-z][a-z0-9_]*)(?:=(?P<value>[^`\s]+))?`")


def in_flags(text: str) -> str:
    """Write `dwell_s` and `mode=offline` as --dwell-s and --mode offline."""

    def flag(match: re.Match[str]) -> str:
        name = "--" + match["name"].replace("_", "-")
        return name if match["value"] is None else f"{name} {match['value']}"

    return _NAMED.sub(flag, text)
