"""Every error that massid raises on purpose, and the exit code each one ends the command line with."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import ClassVar


class MassidError(Exception):
    """Base of all errors whose message is meant for the user: one line, no traceback."""

    exit_code: ClassVar[int] = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(printable(message))


class BadInputError(MassidError):
    """A file, a name or a number that cannot be used as it is."""


class LogError(BadInputError):
    """A log that cannot be read, or does not hold what identification needs."""


class ModelError(BadInputError):
    """A robot model that cannot be used, or lacks a name that was asked for."""


class NotIdentifiableError(MassidError):
    """The log does not reveal a mass that was asked for."""

    exit_code: ClassVar[int] = 3


class DivergedBankError(MassidError):
    """Too few identification models stayed finite to compute a search direction."""

    exit_code: ClassVar[int] = 4


class FallError(MassidError):
    """The robot fell while its walk was being recorded."""

    exit_code: ClassVar[int] = 4


class StoppedError(MassidError):
    """Work was stopped before it found anything."""

    exit_code: ClassVar[int] = 130


def printable(text: str) -> str:
    """Put a text on one line without control characters: names out of damaged files can hold anything."""
    line = " ".join(text.split())
    return line if line.isprintable() else "".join(c if c.isprintable() else "?" for c in line)


def unknown_name(kind: str, name: str, known: Iterable[str], owner: str) -> str:
    """Build the message for a name that does not exist: what was found, the nearest names, all names."""
    names = list(known)
    close = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    hint = f" Did you mean {', '.join(close)}?" if close else ""
    listed = ", ".join(names) if names else "none"
    return f"{owner} has no {kind} named '{name}'.{hint} It has: {listed}."
