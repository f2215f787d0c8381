"""Command-line arguments that several commands take: types shown in --help by what they take, and how they are read."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import tyro

from massid.errors import BadInputError
from massid.model.unknowns.spaces import kinds
from massid.outputs import NamedFile

OptionalFile: TypeAlias = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
OptionalModel: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="MODEL", help_behavior_hint="")]
OptionalTopics: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="FILE|PRESET", help_behavior_hint="")]
OptionalLinks: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="A,B,C", help_behavior_hint="")]
OptionalKg: TypeAlias = Annotated[float | None, tyro.conf.arg(metavar="KG", help_behavior_hint="")]
OptionalHz: TypeAlias = Annotated[float | None, tyro.conf.arg(metavar="HZ", help_behavior_hint="")]
MassErrorList: TypeAlias = Annotated[tuple[str, ...], tyro.conf.arg(metavar="[LINK=+KG ...]", help_behavior_hint="")]
UnknownList: TypeAlias = Annotated[
    tuple[str, ...],
    tyro.conf.arg(
        metavar="[KIND/TARGET ...]",
        help=f"What else is unknown, of any kind: {', '.join(kinds())}.",
        help_behavior_hint="",
    ),
]
PayloadList: TypeAlias = Annotated[tuple[str, ...], tyro.conf.arg(metavar="[BODY@X,Y,Z ...]", help_behavior_hint="")]


def parse_names(option: str, text: str | None) -> list[str]:
    """Names separated by commas; none if the option was left out.

    Raises:
        BadInputError: a name is empty.
    """
    if text is None:
        return []
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise BadInputError(f"{option} {text!r} has an empty name; expected names separated by single commas.")
    return names


def topics_file(topics: str | None) -> NamedFile:
    """The topic map as a file that is read; presets come with massid."""
    return ("the topic map (--topics)", None if topics is None else Path(topics))
