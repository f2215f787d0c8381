"""What is wrong with a document, in a user's words: which file, which entry, what was found and what was expected.

msgspec says what it expected and where, but neither what it found nor, in a mapping, under which name: it writes
``$.links[...].nominal_kg``. The document itself holds both.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec

_KINDS = {
    "float": "a finite number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "an object",
}
"""What msgspec calls a kind of value, and what we do."""
_ANY = "..."


def explain(error: msgspec.ValidationError, document: Any, kind: Any, source: str) -> str:
    """Say what msgspec found wrong.

    Args:
        error: what `msgspec.convert` raised for the document.
        document: plain JSON values.
        kind: type that the document should have had.
        source: name of the file.
    """
    said, _, at = str(error).partition(" - at `$")
    names = _named(error, document, kind, re.findall(r"\w+|\.\.\.", at))
    where, value = "".join(f"/{name}" for name in names), _value(document, names)
    lacking = re.fullmatch(r"Object missing required field `(\w+)`", said)
    if lacking:
        return missing(source, where, lacking[1], value)
    shown = {dict: "an object", list: "a list", type(None): "null", bool: str(value).lower()}.get(
        type(value), repr(value)
    )
    return f"{source}: {where} is {shown[:40]}; expected {_expected(said)}."


def missing(source: str, where: str, name: str, entries: Iterable[str]) -> str:
    """Say that an object has no entry of a name."""
    return f"{source} has no entry {where}/{name}; it has: {', '.join(entries) or 'none'}."


def _expected(said: str) -> str:
    if said == "Number out of range":
        return _KINDS["float"]
    found = re.fullmatch(r"Expected `(.*?)`(.*?)(, got .*)?", said)
    if found is None:
        return said
    kinds = [_KINDS.get(kind, kind) for kind in found[1].split(" | ")]
    limit = found[2].removesuffix(".0").replace(">=", "at least").replace("<=", "at most").replace(">", "above")
    return f"{', '.join(kinds[:-1])} or {kinds[-1]}{limit}" if len(kinds) > 1 else f"{kinds[0]}{limit}"


def _named(error: msgspec.ValidationError, document: Any, kind: Any, steps: Sequence[str]) -> list[str | int]:
    """The path to an entry with the names that msgspec leaves out.

    The name is that of the entry which, left alone in its mapping, is complained of in the same way.
    """
    names: list[str | int] = []
    for step in steps:
        value = _value(document, names)
        if isinstance(value, list):
            names.append(int(step))
        elif step != _ANY:
            names.append(step)
        else:
            names.append(next(name for name in value if _is_said(error, _only(document, names, name), kind)))
            document = _only(document, names[:-1], str(names[-1]))
    return names


def _is_said(error: msgspec.ValidationError, document: Any, kind: Any) -> bool:
    try:
        msgspec.convert(document, kind)
    except msgspec.ValidationError as other:
        return str(other) == str(error)
    return False


def _only(document: Any, names: Sequence[str | int], name: str) -> Any:
    """The document with one entry alone in the mapping that names lead to."""
    if not names:
        return {name: document[name]}
    first, *rest = names
    inner = _only(document[first], rest, name)
    if isinstance(document, Mapping):
        return {**document, first: inner}
    return [inner if k == first else each for k, each in enumerate(document)]


def _value(document: Any, names: Iterable[str | int]) -> Any:
    for name in names:
        document = document[name]
    return document
