"""What massid needs at run time may be used, changed and sold by whoever may do so with massid itself (Apache-2.0)."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from email.message import Message
from enum import IntEnum
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]

READ_BY_HAND: dict[str, str] = {}
"""Distributions whose metadata cannot be read here, and the SPDX expression that a person read in them."""

LESSER_FOR_A_REASON: dict[str, str] = {}
"""Distributions under the LGPL that may stay, and why."""


class Kind(IntEnum):
    """Of licences, the better first: of alternatives the least counts, of parts the largest."""

    PERMISSIVE = 0  # or bound to single files, as the MPL
    LESSER = 1
    COPYLEFT = 2
    UNREADABLE = 3


PERMISSIVE = re.compile(
    r"\b(mit(-cmu|-0)?|0?bsd|apache|asl|isc|mpl|mozilla public|psf|psfl|python software foundation|python-2|zlib|cc0"
    r"|unlicense|public domain|hpnd|boost software|bsl-1|expat)(\b|[-\d])",
    re.IGNORECASE,
)
LESSER = re.compile(r"lgpl|(lesser|library) general public", re.IGNORECASE)
COPYLEFT = re.compile(r"gpl|general public|affero", re.IGNORECASE)
OR_LATER = re.compile(r"\s+or\s+(\(at your option\)\s+)?(any\s+)?(later|newer|higher|above)\b", re.IGNORECASE)
ALTERNATIVE = re.compile(r"\s+or\s+|/|\|", re.IGNORECASE)
JOINED = re.compile(r"\s(or|and)\s", re.IGNORECASE)
OPENINGS = {
    "gnu lesser general public license": Kind.LESSER,
    "gnu library general public license": Kind.LESSER,
    "gnu general public license": Kind.COPYLEFT,
    "gnu affero general public license": Kind.COPYLEFT,
    "mit license": Kind.PERMISSIVE,
    "permission is hereby granted, free of charge": Kind.PERMISSIVE,
    "redistribution and use in source and binary forms": Kind.PERMISSIVE,
    "apache license": Kind.PERMISSIVE,
    "mozilla public license": Kind.PERMISSIVE,
}
"""How the texts of licences begin, in lower case and with single spaces."""
LONGEST_NAME = 200
"""Characters; what is longer is no licence's name but its text."""


def kind_of_one(name: str) -> Kind:
    """Of a single licence; what an exception (WITH) takes back from the GPL is for LESSER_FOR_A_REASON to say."""
    name = re.split(r"\s+with\s+", name, flags=re.IGNORECASE)[0]
    rest = LESSER.sub("", name)
    if COPYLEFT.search(rest):
        return Kind.COPYLEFT
    if rest != name:
        return Kind.LESSER
    return Kind.PERMISSIVE if PERMISSIVE.search(name) else Kind.UNREADABLE


def kind_of_name(name: str) -> Kind:
    """Of an SPDX expression or what resembles one, as "MIT OR GPL-2.0-or-later" and "BSD and GPL v2 or later"."""
    name = OR_LATER.sub(" ", name)
    while brackets := re.search(r"\(([^()]*)\)", name):
        inside = brackets[1]
        if JOINED.search(inside):  # else it is a remark
            inside = ("MIT", "LGPL", "GPL", "?")[kind_of_name(inside)]
        name = f"{name[: brackets.start()]} {inside} {name[brackets.end() :]}"
    alternatives = (re.split(r"\s+and\s+|&", part, flags=re.IGNORECASE) for part in ALTERNATIVE.split(name))
    return min(max(map(kind_of_one, parts)) for parts in alternatives)


def kind_of_text(text: str) -> Kind:
    """Of a licence's full text: whose words come first; what a wheel bundles is listed behind."""
    text = " ".join(text.lower().split())
    found = {text.index(words): kind for words, kind in OPENINGS.items() if words in text}
    return found[min(found)] if found else Kind.UNREADABLE


def kind_of_classifiers(classifiers: Iterable[str], field: str) -> Kind:
    """Several classifiers do not tell whether all hold or any; an "or" in the licence field does."""
    kinds = {kind_of_one(text.rpartition("::")[2]) for text in classifiers if text != "License :: OSI Approved"}
    if len(kinds) > 1 and len(field) <= LONGEST_NAME and ALTERNATIVE.search(OR_LATER.sub(" ", field)):
        return kind_of_name(field)
    return max(kinds, default=Kind.UNREADABLE)


def kind_of(metadata: Message, files: Iterable[str] = ()) -> Kind:
    """Of a distribution, by the first of these that can be read: expression, classifiers, field, files."""
    if expression := metadata["License-Expression"]:
        return kind_of_name(expression)
    field = (metadata["License"] or "").strip()
    classifiers = [text for text in metadata.get_all("Classifier", []) if text.startswith("License ::")]
    kind = kind_of_classifiers(classifiers, field)
    if kind is Kind.UNREADABLE and field:
        kind = kind_of_name(field) if len(field) <= LONGEST_NAME else kind_of_text(field)
    if kind is Kind.UNREADABLE:
        kind = max(map(kind_of_text, files), default=Kind.UNREADABLE)
    return kind


def licence_files(found: Distribution) -> Iterable[str]:
    """Texts of the licence files beside a distribution's metadata, opened when they are asked for."""
    paths = [path for path in found.files or [] if path.parts[0].endswith(".dist-info")]
    return (path.read_text() for path in paths if re.match(r"licen[cs]e|copying", path.name, re.IGNORECASE))


def needed(groups: Iterable[str] = ()) -> dict[str, Distribution]:
    """Everything that massid's dependencies, and those of groups, bring with them here, by name.

    They are read from pyproject.toml: what is installed may have the metadata of an older massid.
    """
    content = tomllib.loads((ROOT / "pyproject.toml").read_text())
    lines = content["project"]["dependencies"] + [
        line for group in groups for line in content["dependency-groups"][group]
    ]
    todo = [(Requirement(line), {""}) for line in lines]
    seen: set[tuple[str, frozenset[str]]] = set()
    found: dict[str, Distribution] = {}
    while todo:
        requirement, extras = todo.pop()
        name = canonicalize_name(requirement.name)
        asked = (name, frozenset(requirement.extras))
        marker = requirement.marker
        if asked in seen or (marker and not any(marker.evaluate({"extra": extra}) for extra in extras)):
            continue
        seen.add(asked)
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:
            pytest.fail(f"{name} is not installed; install massid anew")
        todo += [(Requirement(line), {"", *requirement.extras}) for line in found[name].requires or []]
    return found


@pytest.fixture(scope="module")
def distributions() -> dict[str, Distribution]:
    return needed()


def test_nothing_that_is_needed_asks_for_more_than_massid_does(distributions: dict[str, Distribution]) -> None:
    assert {"numpy", "dm-control", "dm-env"} <= distributions.keys()  # the last is dm-control's own dependency
    refused = {}
    for name, found in distributions.items():
        by_hand = READ_BY_HAND.get(name)
        kind = kind_of_name(by_hand) if by_hand else kind_of(found.metadata, licence_files(found))
        if kind > (Kind.LESSER if name in LESSER_FOR_A_REASON else Kind.PERMISSIVE):
            refused[name] = kind.name
    assert not refused


def test_the_tables_name_only_what_is_needed(distributions: dict[str, Distribution]) -> None:
    assert READ_BY_HAND.keys() | LESSER_FOR_A_REASON.keys() <= distributions.keys()
    for name in READ_BY_HAND:
        assert kind_of(distributions[name].metadata, licence_files(distributions[name])) is Kind.UNREADABLE
    for reason in LESSER_FOR_A_REASON.values():
        assert len(reason.split()) >= 5


OSI = "License :: OSI Approved :: "
GPL_TEXT = "GNU GENERAL PUBLIC LICENSE\n  Version 3 ... consider the GNU Lesser General\nPublic License instead"
BSD_TEXT = "Copyright (c) 2001 X\n\nRedistribution and use in source\n and binary forms ... GNU General Public License"


@pytest.mark.parametrize(
    ("headers", "kind"),
    [
        ({"License-Expression": "MIT OR GPL-3.0-only"}, Kind.PERMISSIVE),
        ({"License-Expression": "GPL-3.0-or-later"}, Kind.COPYLEFT),
        ({"License-Expression": "AGPL-3.0-only"}, Kind.COPYLEFT),
        ({"License-Expression": "LGPL-2.1-or-later"}, Kind.LESSER),
        ({"License-Expression": "LGPL-2.1-or-later OR GPL-2.0-or-later"}, Kind.LESSER),
        ({"License-Expression": "MIT AND GPL-2.0-only"}, Kind.COPYLEFT),
        ({"License-Expression": "BSD-3-Clause AND (MIT OR GPL-2.0-only)"}, Kind.PERMISSIVE),
        ({"License-Expression": "(MIT OR BSD-3-Clause) AND GPL-2.0-only"}, Kind.COPYLEFT),
        ({"License-Expression": "((MIT AND LGPL-3.0-only) OR GPL-2.0-only) AND ISC"}, Kind.LESSER),
        ({"License-Expression": "MIT OR Apache-2.0 AND GPL-2.0-only"}, Kind.PERMISSIVE),
        ({"License-Expression": "Apache-2.0 WITH LLVM-exception"}, Kind.PERMISSIVE),
        ({"License-Expression": "GPL-3.0-or-later WITH GCC-exception-3.1"}, Kind.COPYLEFT),
        ({"License-Expression": "LicenseRef-Ours"}, Kind.UNREADABLE),
        ({"License-Expression": "MIT AND LicenseRef-Ours"}, Kind.UNREADABLE),
        ({"License-Expression": "GPL-3.0-only", "Classifier": [OSI + "MIT License"]}, Kind.COPYLEFT),
        ({"Classifier": [OSI + "GNU General Public License v2 or later (GPLv2+)"]}, Kind.COPYLEFT),
        ({"Classifier": [OSI + "GNU Affero General Public License v3"]}, Kind.COPYLEFT),
        ({"Classifier": [OSI + "GNU Library or Lesser General Public License (LGPL)"]}, Kind.LESSER),
        ({"Classifier": [OSI + "GNU Lesser General Public License v3 or later (LGPLv3+)"]}, Kind.LESSER),
        ({"Classifier": [OSI + "Mozilla Public License 2.0 (MPL 2.0)"]}, Kind.PERMISSIVE),
        ({"Classifier": ["License :: OSI Approved"], "License": "BSD"}, Kind.PERMISSIVE),
        ({"Classifier": ["License :: Other/Proprietary License"]}, Kind.UNREADABLE),
        ({"Classifier": [OSI + "MIT License", OSI + "GNU General Public License v2 (GPLv2)"]}, Kind.COPYLEFT),
        (
            {
                "Classifier": [OSI + "MIT License", OSI + "GNU General Public License v2 (GPLv2)"],
                "License": "MIT or GPL",
            },
            Kind.PERMISSIVE,
        ),
        (
            {
                "Classifier": [OSI + "MIT License", OSI + "GNU General Public License v2 (GPLv2)"],
                "License": "v2 or later",
            },
            Kind.COPYLEFT,
        ),
        ({"License": "MIT License"}, Kind.PERMISSIVE),
        ({"License": "3-Clause BSD License"}, Kind.PERMISSIVE),
        ({"License": "Apache License, Version 2.0"}, Kind.PERMISSIVE),
        ({"License": "Dual licence: MIT or GPL"}, Kind.PERMISSIVE),
        ({"License": "GPLv2+"}, Kind.COPYLEFT),
        ({"License": "GNU GPL v2 or (at your option) any later version"}, Kind.COPYLEFT),
        ({"License": "BSD and GPL v2 or later"}, Kind.COPYLEFT),
        ({"License": "UNKNOWN"}, Kind.UNREADABLE),
        ({"License": "Admittedly ours"}, Kind.UNREADABLE),
        ({"License": 9 * GPL_TEXT}, Kind.COPYLEFT),
        ({"License": 9 * BSD_TEXT}, Kind.PERMISSIVE),
        ({}, Kind.UNREADABLE),
    ],
)
def test_licences_are_read(headers: dict[str, str | list[str]], kind: Kind) -> None:
    metadata = Message()
    for name, values in headers.items():
        for value in [values] if isinstance(values, str) else values:
            metadata[name] = value
    assert kind_of(metadata) is kind


@pytest.mark.parametrize(
    ("files", "kind"),
    [
        ([BSD_TEXT], Kind.PERMISSIVE),
        ([GPL_TEXT], Kind.COPYLEFT),
        ([GPL_TEXT.replace("GENERAL", "LESSER GENERAL", 1)], Kind.LESSER),
        ([BSD_TEXT, GPL_TEXT], Kind.COPYLEFT),
        (["All rights reserved."], Kind.UNREADABLE),
    ],
)
def test_licence_files_are_read_where_the_metadata_are_silent(files: list[str], kind: Kind) -> None:
    assert kind_of(Message(), files) is kind
    metadata = Message()
    metadata["License"] = "ISC"
    assert kind_of(metadata, files) is Kind.PERMISSIVE
