"""The massid command line."""

from __future__ import annotations

import sys
from collections.abc import Sequence

__all__ = ["CONTRADICTED", "INTERRUPTED", "NOT_IDENTIFIABLE", "main"]

INTERRUPTED = 130
NOT_IDENTIFIABLE = 3
CONTRADICTED = 5
"""The log denies how it was read, or what was found: these are not the robot's masses."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code. Loading takes seconds, in which it can be interrupted as well."""
    try:
        from massid.cli.app import run

        return run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        sys.stderr.write("massid: interrupted\n")
        return INTERRUPTED
