"""Entry point: parses arguments, runs one command, turns errors into one line and an exit code."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Annotated, TypeAlias

import tyro

from massid.cli.demo import Demo
from massid.cli.identify import Identify
from massid.cli.links import Links
from massid.cli.record import Record
from massid.cli.view import View
from massid.errors import MassidError

Command: TypeAlias = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Record, tyro.conf.subcommand("record")]
    | Annotated[Identify, tyro.conf.subcommand("identify")]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[Links, tyro.conf.subcommand("links")]
)

DESCRIPTION = """Weighs the links of a humanoid robot while the robot walks.

Exit codes: 0 good, 2 bad input, 3 not identifiable, 4 fell or did not converge."""

INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    command = tyro.cli(
        Command,  # type: ignore[arg-type]  # tyro takes unions, which have no runtime type of their own
        prog="massid",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.FlagConversionOff, tyro.conf.HelptextFromCommentsOff),
    )
    try:
        return command.run()
    except MassidError as error:
        sys.stderr.write(f"massid: error: {error}\n")
        return error.exit_code
    except KeyboardInterrupt:
        sys.stderr.write("massid: interrupted\n")
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of our output went away (for example `massid links atlas | head -1`).
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
