"""A result document on disk: indented JSON, and every entry of it checked when it is read back."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from massid.errors import BadInputError
from massid.inputs import LARGEST_TEXT, problem_of
from massid.outputs import write_file
from massid.result.document import SCHEMA, Document
from massid.result.explanation import explain, missing

LARGEST = 1e100
"""No quantity of a robot is larger, and sums of squares of such numbers are finite."""
_SHOWN = 40
_MARKS = {"links", "iterations", "logs", "status"}
"""Entries by which a result is told from other JSON."""


def plain(value: Any) -> Any:
    """A document, or anything made of such types, as plain JSON values."""
    return msgspec.to_builtins(value, enc_hook=_number)


def as_json(value: Any) -> bytes:
    """A document, or anything else that is made of JSON values, as the content of a file.

    Raises:
        ValueError: a number is not finite; JSON has none such, and msgspec would write null for it.
    """
    return f"{json.dumps(plain(value), indent=2, allow_nan=False)}\n".encode()


def write_json(value: Any, path: Path) -> None:
    """Write a document, or anything else that is made of JSON values.

    Raises:
        BadInputError: the file cannot be written.
        ValueError: as `as_json` does.
    """
    write_file(path, as_json(value))


def read_document(path: Path) -> Document:
    """Read what `write_json` wrote of a result.

    Raises:
        BadInputError: it cannot be read, is something else or of another schema, lacks an entry, or has one of another
            kind or a number that is not finite.
    """
    entries = _parse(path)
    if not isinstance(entries, dict) or not entries.keys() >= _MARKS:
        raise BadInputError(f"{path} is not a result; expected what massid identify --json wrote.")
    schema = entries.get("schema")
    if schema != SCHEMA:
        found = "no schema" if schema is None else f"schema {str(schema)[:40]}"
        raise BadInputError(f"{path} has {found}; expected schema {SCHEMA}, which massid identify --json writes.")
    try:
        document = _convert(entries, path)
    except UnicodeError as error:
        raise BadInputError(f"{path} holds half of a character: {error}.") from error
    _check_links(document, path)
    return document


def _convert(entries: dict[str, Any], path: Path) -> Document:
    try:
        return msgspec.convert(entries, Document)
    except msgspec.ValidationError as error:
        raise BadInputError(explain(error, entries, Document, str(path))) from error


def _parse(path: Path) -> Any:
    """JSON as plain values, all of them finite; the standard library's reader can name a number that is not."""
    if problem := problem_of(path, LARGEST_TEXT):
        raise BadInputError(f"Cannot read {path}: it {problem}.")
    try:
        return json.loads(
            path.read_text(encoding="utf-8"), parse_constant=_finite, parse_float=_finite, parse_int=_whole
        )
    except OSError as error:
        raise BadInputError(f"Cannot read {path}: {error.strerror}.") from error
    except _NotFiniteError as error:
        raise BadInputError(f"{path} holds the number {error}; expected finite ones up to {LARGEST:g}.") from error
    except (ValueError, RecursionError) as error:
        raise BadInputError(f"{path} is not JSON; expected what massid identify --json wrote.") from error


class _NotFiniteError(Exception):
    """A number in JSON that is not finite, or too large to be any quantity: its square would not be finite."""


def _finite(text: str) -> float:
    value = float(text)
    if not abs(value) <= LARGEST:  # nan, too
        raise _NotFiniteError(text[:_SHOWN])
    return value


def _whole(text: str) -> int:
    value = int(text)
    if LARGEST < abs(value) < sys.float_info.max:  # larger ones are no numbers to whoever checks the entries
        raise _NotFiniteError(f"{text[:_SHOWN]}... of {len(text)} digits")
    return value


def _check_links(document: Document, path: Path) -> None:
    """Pass if whatever has a number for each link has one for every link."""
    rows = {f"/iterations/{k}/estimate_kg": one.estimate_kg for k, one in enumerate(document.iterations)}
    rows |= {f"/iterations/{k}/std_kg": one.std_kg for k, one in enumerate(document.iterations) if one.std_kg}
    if document.verdict:
        rows["/verdict/predicted_std_kg"] = document.verdict.predicted_std_kg
    if document.reference:
        rows["/reference/estimate_kg"] = document.reference.estimate_kg
    for where, row in rows.items():
        for link in document.links:
            if link not in row:
                raise BadInputError(missing(str(path), where, link, row))


def _number(value: Any) -> Any:
    """What numpy computed, as Python's own number."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} is no JSON value")
