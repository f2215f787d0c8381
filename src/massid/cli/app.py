"""Entry point: parses arguments, runs one command, turns errors into one line and an exit code."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import Annotated, Any, Protocol, Union, cast, get_args

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from massid.cli.corrupt import Corrupt
from massid.cli.demo import Demo
from massid.cli.flags import in_flags
from massid.cli.identify import Identify
from massid.cli.inspect import Inspect
from massid.cli.links import Links
from massid.cli.paper import Paper
from massid.cli.record import Record
from massid.cli.repair import Repair
from massid.cli.report import Report
from massid.cli.view import View
from massid.errors import BadInputError, MassidError
from massid.ranges import OptionError
from massid.search.directions import Direction, direction_name, direction_names

DESCRIPTION = """Weighs the links of a humanoid robot while the robot walks.

Exit codes: 0 good, 2 bad input, 3 not identifiable, 4 fell or did not converge."""

COMMANDS = (Demo, Record, Identify, Inspect, Repair, Corrupt, Report, View, Paper, Links)


class Command(Protocol):
    """One subcommand: a dataclass of its arguments."""

    def run(self) -> int:
        """Do it; returns the exit code."""


def run(arguments: Sequence[str]) -> int:
    """Run one command; returns the exit code."""
    try:
        if list(arguments) == ["--version"]:
            sys.stdout.write(f"massid {version('massid')}\n")
            return 0
        return _parse(arguments).run()
    except OptionError as error:
        sys.stderr.write(f"massid: error: --{error.option.replace('_', '-')} {error.problem}\n")
        return error.exit_code
    except MassidError as error:
        sys.stderr.write(f"massid: error: {in_flags(str(error))}\n")
        return error.exit_code
    except BrokenPipeError:
        # The reader of our output went away, as in `massid links atlas | head -1`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk, a folder that was taken away
        sys.stderr.write(f"massid: error: {error.filename or 'writing'}: {error.strerror or error}\n")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BadInputError.exit_code


def _parse(arguments: Sequence[str]) -> Command:
    """Build the command that the arguments describe; ends the program with code 2 when they describe none."""
    described: list[Any] = [
        Annotated[
            command, tyro.conf.subcommand(command.__name__.lower(), description=inspect.cleandoc(command.__doc__ or ""))
        ]
        for command in COMMANDS
    ]
    union: Any = Union[tuple(described)]  # noqa: UP007  # built at run time
    parsed = tyro.cli(
        union,
        prog="massid",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes,),
        registry=_registry(),
    )
    return cast("Command", parsed)


def _registry() -> ConstructorRegistry:
    """What tyro does not know by itself: a direction is typed by its name."""
    registry = ConstructorRegistry()

    @registry.primitive_rule
    def direction(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Any] | None:
        if Direction not in get_args(info.type):
            return None
        return PrimitiveConstructorSpec(
            nargs=1,
            metavar="{" + ",".join(direction_names()) + "}",
            instance_from_str=lambda words: words[0],
            is_instance=lambda value: isinstance(value, str),
            str_from_instance=lambda value: [direction_name(value)],
            choices=direction_names(),
        )

    return registry
