"""Types of command-line arguments that may be left out, shown in --help by what they take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import tyro

OptionalFile: TypeAlias = Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")]
OptionalModel: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="MODEL", help_behavior_hint="")]
OptionalTopics: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="FILE|PRESET", help_behavior_hint="")]
OptionalLinks: TypeAlias = Annotated[str | None, tyro.conf.arg(metavar="A,B,C", help_behavior_hint="")]
OptionalKg: TypeAlias = Annotated[float | None, tyro.conf.arg(metavar="KG", help_behavior_hint="")]
MassErrorList: TypeAlias = Annotated[tuple[str, ...], tyro.conf.arg(metavar="[LINK=+KG ...]", help_behavior_hint="")]
PayloadList: TypeAlias = Annotated[tuple[str, ...], tyro.conf.arg(metavar="[BODY@X,Y,Z ...]", help_behavior_hint="")]
