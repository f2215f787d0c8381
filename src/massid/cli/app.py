"""Entry point: parses arguments, runs one command, turns errors into one line and an exit code."""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Sequence
from dataclasses import make_dataclass
from importlib import import_module
from importlib.metadata import version
from io import TextIOWrapper
from typing import Annotated, Any, Protocol, Union, cast, get_args

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from massid.errors import BadInputError, MassidError, on_one_line

DESCRIPTION = """Weighs the links of a humanoid robot while the robot walks.

Exit codes: 0 good, 2 bad input, 3 not identifiable, 4 fell or did not converge, 5 contradicted by the log itself."""

COMMANDS = {
    "demo": "Record a walking humanoid with hidden mass errors, then find its masses from the log.",
    "record": "Let a simulated robot walk with hidden mass errors, and log it to MCAP.",
    "identify": "Find the masses of a robot's links from the log of a walk, or from several logs of the same robot.",
    "inspect": "Show what logs hold and whether they make sense for a robot, before masses are identified from them.",
    "repair": "Copy what is sound of a damaged MCAP file into a new one, and say what was lost.",
    "corrupt": "Give a log without noise the sensors of a real robot.",
    "report": "Make one page of a result: masses with intervals, convergence, held-out torques, residuals, nuisances.",
    "compare": "Compare results: of other days, of a robot's sisters, of other methods; which links differ?",
    "view": "Open a recording written by `massid identify --rerun` or `massid demo` in the Rerun viewer.",
    "paper": "Run the paper's simulations again: its figures and Table I beside its numbers, and its theory as checks.",
    "links": "List the links of a robot with their nominal masses, as --links takes them.",
}
"""Every command and what it is for. Each is a module of this folder, which is loaded when its command is asked for."""


class Command(Protocol):
    """One subcommand: a dataclass of its arguments."""

    def run(self) -> int:
        """Do it; returns the exit code."""


def run(arguments: Sequence[str]) -> int:
    """Run one command; returns the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # what this terminal has no sign for is written by number
            stream.reconfigure(errors="backslashreplace")
    try:
        if list(arguments) == ["--version"]:
            sys.stdout.write(f"massid {version('massid')}\n")
            return 0
        return _parse(arguments).run()
    except MassidError as error:
        from massid.cli.flags import in_flags
        from massid.ranges import OptionError

        if isinstance(error, OptionError):
            said = f"--{error.option.replace('_', '-')} {error.problem}"
        else:
            said = in_flags(str(error))
        sys.stderr.write(f"massid: error: {said}\n")
        return error.exit_code
    except BrokenPipeError:
        # The reader of our output went away, as in `massid links atlas | head -1`.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:  # a full disk, a folder that was taken away
        said = on_one_line(f"{error.filename or 'writing'}: {error.strerror or error}")
        sys.stderr.write(f"massid: error: {said}\n")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BadInputError.exit_code


def _parse(arguments: Sequence[str]) -> Command:
    """Build the command that the arguments describe; ends the program with code 2 when they describe none."""
    asked = arguments[0] if arguments else ""
    described: list[Any] = [_described(name, loaded=name == asked) for name in COMMANDS]
    union: Any = Union[tuple(described)]  # noqa: UP007  # built at run time
    parsed = tyro.cli(
        union,
        prog="massid",
        description=DESCRIPTION,
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes,),
        registry=_registry() if asked in COMMANDS else None,
    )
    return cast("Command", parsed)


def _described(name: str, *, loaded: bool) -> Any:
    """A command for tyro: its class, or only what it is for."""
    if not loaded:
        placeholder = make_dataclass(name.capitalize(), [])
        return Annotated[placeholder, tyro.conf.subcommand(name, description=COMMANDS[name])]
    command = getattr(import_module(f"massid.cli.{name}"), name.capitalize())
    return Annotated[command, tyro.conf.subcommand(name, description=inspect.cleandoc(command.__doc__ or ""))]


def _registry() -> ConstructorRegistry:
    """What tyro does not know by itself: a direction is typed by its name."""
    from massid.search.directions import Direction, direction_name, direction_names

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
