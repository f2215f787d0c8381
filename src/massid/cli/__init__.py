"""The massid command line."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from massid.cli.interrupts import EndedError, end_on_signals

__all__ = ["CONTRADICTED", "INTERRUPTED", "NOT_IDENTIFIABLE", "main"]

INTERRUPTED = 130
NOT_IDENTIFIABLE = 3
CONTRADICTED = 5
"""The log denies how it was read, or what was found: these are not the robot's masses."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code. Loading takes seconds, in which it can be interrupted as well."""
    try:
        with end_on_signals():
            from massid.cli.app import run

            return run(sys.argv[1:] if arguments is None else arguments)
    except (KeyboardInterrupt, ImportError) as error:
        # A library in C whose loading is interrupted says that it cannot be loaded.
        ended = error if isinstance(error, KeyboardInterrupt) else error.__cause__ or error.__context__
        if isinstance(ended, EndedError):
            sys.stderr.write(f"massid: ended by {ended}\n")
            return 128 + ended.number
        if not isinstance(ended, KeyboardInterrupt):
            raise
        sys.stderr.write("massid: interrupted\n")
        return INTERRUPTED
