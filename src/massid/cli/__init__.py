"""The massid command line."""

from __future__ import annotations

import sys
from collections.abc import Sequence

__all__ = ["INTERRUPTED", "MISREAD", "NOT_IDENTIFIABLE", "main"]

INTERRUPTED = 130
NOT_IDENTIFIABLE = 3
MISREAD = 4
"""The log was read in a convention that it contradicts: whatever is found is not the robot's masses."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code. Loading takes seconds, in which it can be interrupted as well."""
    try:
        from massid.cli.app import run

        return run(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        sys.stderr.write("massid: interrupted\n")
        return INTERRUPTED
