"""Every error that massid raises on purpose, and the exit code each one ends the command line with."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import ClassVar

LONGEST_LINE = 4000
"""Characters of a message; a name in it can be as long as its file."""
_NBSP = "\N{NO-BREAK SPACE}"
_LONGEST_COMPARED, _MOST_COMPARED = 200, 2000


class MassidError(Exception):
    """Base of all errors whose message is meant for the user: one line, no traceback."""

    exit_code: ClassVar[int] = 2

    def __init__(self, message: str = "") -> None:
        super().__init__(on_one_line(message))


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
    """A text as it may be shown: names out of files can hold anything, and must not steer what shows them.

    What ends a line or is otherwise no printable character becomes a space or a question mark: control characters,
    marks that turn the direction of writing, halves of characters. Signs of markup are for each output to take care of.
    """
    return text if text.isprintable() else "".join(map(_printable, text))


def _printable(character: str) -> str:
    if character.isprintable() or character == _NBSP:
        return character
    return " " if character.isspace() else "?"


def on_one_line(text: str) -> str:
    """A text as it may be shown, with single spaces, and cut if nobody would read to its end."""
    return cut(" ".join(printable(text).replace(_NBSP, " ").split()))


def cut(text: str) -> str:
    """A text, or its beginning if nobody would read to its end."""
    rest = len(text) - LONGEST_LINE
    return text if rest <= 0 else f"{text[:LONGEST_LINE]} ... ({rest} characters more)"


def close_names(name: str, known: Iterable[str], most: int, cutoff: float) -> list[str]:
    """Names like another one, the nearest first; none if comparing would take longer than anybody waits."""
    short = [other for other in known if len(other) <= _LONGEST_COMPARED]
    if len(name) > _LONGEST_COMPARED or len(short) > _MOST_COMPARED:
        return []
    return difflib.get_close_matches(name, short, n=most, cutoff=cutoff)


def unknown_name(kind: str, name: str, known: Iterable[str], owner: str) -> str:
    """Build the message for a name that does not exist: what was found, the nearest names, all names."""
    names = list(known)
    close = close_names(name, names, most=3, cutoff=0.5)
    hint = f" Did you mean {', '.join(close)}?" if close else ""
    listed = ", ".join(names) if names else "none"
    return f"{owner} has no {kind} named '{name}'.{hint} It has: {listed}."
