"""What the report needs of a result document, checked before anything is drawn."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from massid.errors import BadInputError


@dataclass(frozen=True)
class _Value:
    """A value without parts."""

    expected: str
    holds: Callable[[Any], bool]


@dataclass(frozen=True)
class _List:
    """Any number of the same."""

    item: _Shape


@dataclass(frozen=True)
class _Map:
    """Any names, each with the same."""

    item: _Shape


@dataclass(frozen=True)
class _Object:
    """Entries with names of their own; optional ones may be missing or null."""

    required: Mapping[str, _Shape]
    optional: Mapping[str, _Shape] = field(default_factory=dict)


_Shape: TypeAlias = _Value | _List | _Map | _Object


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


_TEXT = _Value("a text", lambda value: isinstance(value, str))
_FLAG = _Value("true or false", lambda value: isinstance(value, bool))
_NUMBER = _Value("a finite number", _is_number)
_POSITIVE = _Value("a finite number above 0", lambda value: _is_number(value) and value > 0)
_NUMBER_OR_NULL = _Value("a finite number or null", lambda value: value is None or _is_number(value))
_INTERVAL = _Value(
    "two finite numbers", lambda value: isinstance(value, list) and len(value) == 2 and all(map(_is_number, value))
)


def check_document(document: Mapping[str, Any], path: Path) -> None:
    """Pass if a result document holds what its report draws.

    Args:
        document: as read from JSON.
        path: it was read from there.

    Raises:
        BadInputError: an entry is missing or of another kind.
    """
    _check(_Object({"links": _Map(_LINK)}), document, "", path)
    _check(_result_of(document["links"]), document, "", path)


_LINK = _Object(
    {"nominal_kg": _POSITIVE, "estimate_kg": _NUMBER_OR_NULL, "identifiable": _FLAG},
    {"std_kg": _NUMBER, "interval95_kg": _INTERVAL, "true_kg": _NUMBER},
)
_QUANTITY = _Object(
    {"nominal": _NUMBER, "estimate": _NUMBER_OR_NULL, "unit": _TEXT}, {"interval95": _INTERVAL, "true": _NUMBER}
)
_VALIDATION = _Object(
    {"held_out_s": _NUMBER},
    {
        "weight": _Object(
            {
                "found_kg": _NUMBER,
                "found_std_kg": _NUMBER,
                "carried_kg": _NUMBER,
                "carried_std_kg": _NUMBER,
                "agrees": _FLAG,
            }
        ),
        "torques": _Object(
            {
                "cutoff_hz": _NUMBER,
                "rms_nominal_nm": _NUMBER,
                "rms_identified_nm": _NUMBER,
                "joints": _Map(_Object({"rms_nominal_nm": _NUMBER, "rms_identified_nm": _NUMBER})),
            }
        ),
    },
)
_UNCERTAINTY = _Object(
    {
        "chi2_per_sample": _NUMBER,
        "nuisances": _Map(
            _Object(
                {"unit": _TEXT, "estimate": _NUMBER, "std": _NUMBER, "prior_std": _POSITIVE},
                {"nominal": _NUMBER, "kind": _TEXT, "title": _TEXT, "label": _TEXT, "log": _NUMBER},
            )
        ),
    },
    {"noise": _Map(_NUMBER)},
)
_OPTIONS = _Object({}, {"noise": _TEXT, "search": _Map(_Value("a value", lambda value: True))})


def _result_of(links: Mapping[str, Any]) -> _Object:
    """The shape of a result that weighed these links."""
    each_link = _Object(dict.fromkeys(links, _NUMBER))
    iteration = _Object({"window": _NUMBER, "time_s": _NUMBER, "estimate_kg": each_link}, {"std_kg": each_link})
    verdict = _Object(
        {
            "motion": _TEXT,
            "sensors": _TEXT,
            "total_std_kg": _NUMBER,
            "predicted_std_kg": each_link,
            "combinations": _List(_Object({"text": _TEXT, "relative_std": _NUMBER})),
            "sums": _List(
                _Object({"links": _List(_TEXT), "nominal_kg": _NUMBER, "std_kg": _NUMBER}, {"estimate_kg": _NUMBER})
            ),
            "advice": _List(_TEXT),
        }
    )
    return _Object(
        {
            "status": _TEXT,
            "mode": _TEXT,
            "logs": _List(_TEXT),
            "warnings": _List(_TEXT),
            "wall_s": _NUMBER,
            "log_s": _NUMBER,
            "iterations": _List(iteration),
        },
        {
            "together": _Object({"estimate_kg": _NUMBER}, {"std_kg": _NUMBER}),
            "quantities": _Map(_QUANTITY),
            "reference": _Object({"method": _TEXT, "cutoff_hz": _NUMBER_OR_NULL, "estimate_kg": each_link}),
            "verdict": verdict,
            "validation": _VALIDATION,
            "uncertainty": _UNCERTAINTY,
            "options": _OPTIONS,
        },
    )


def _check(shape: _Shape, value: Any, where: str, path: Path) -> None:
    match shape:
        case _Value(expected, holds):
            if not holds(value):
                raise _wrong(path, where, value, expected)
        case _List(item):
            if not isinstance(value, list):
                raise _wrong(path, where, value, "a list")
            for k, each in enumerate(value):
                _check(item, each, f"{where}/{k}", path)
        case _Map(item):
            for name, each in _entries(value, where, path).items():
                _check(item, each, f"{where}/{name}", path)
        case _Object(required, optional):
            entries = _entries(value, where, path)
            for name, part in required.items():
                if name not in entries:
                    raise BadInputError(f"{path} has no entry {where}/{name}; it has: {', '.join(entries) or 'none'}.")
                _check(part, entries[name], f"{where}/{name}", path)
            for name, part in optional.items():
                if entries.get(name) is not None:
                    _check(part, entries[name], f"{where}/{name}", path)


def _entries(value: Any, where: str, path: Path) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise _wrong(path, where, value, "an object")
    return value


def _wrong(path: Path, where: str, value: Any, expected: str) -> BadInputError:
    shown = {dict: "an object", list: "a list", type(None): "null", bool: str(value).lower()}.get(
        type(value), repr(value)
    )
    return BadInputError(f"{path}: {where} is {shown[:40]}; expected {expected}.")
