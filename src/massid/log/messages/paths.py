"""Find the numbers of a message that a topic map asks for by dotted path."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from massid.errors import close_names

_RANGE = re.compile(r"\[(\d*):(\d*)\]")
_INDEX = re.compile(r"^(?P<path>.*)\[(?P<index>\d+)\]$")
_SELECT = re.compile(r"\[(?P<name>[A-Za-z_][\w.]*)=(?P<value>[^\]]+)\]")
_LISTED = 30
_AXES = (("x", "y", "z"), ("x", "y", "z", "w"), ("roll", "pitch", "yaw"))


class PathError(ValueError):
    """A path that a message does not have; names those it has."""


class ElementMissing(PathError):
    """A message that holds the array asked for, but not the element of that name."""


@dataclass(frozen=True)
class Pick:
    """A number of a message, or consecutive elements of an array of numbers.

    Attributes:
        path: the number or array.
        part: which elements of an array; None for a number or a whole array.
    """

    path: str
    part: slice | None = None


def find_paths(
    known: Mapping[str, int | None], wanted: Iterable[str], texts: Mapping[str, tuple[str, ...]] | None = None
) -> tuple[Pick, ...]:
    """Resolve paths to numbers, in order.

    Args:
        known: the numbers of a message by path, with the length of an array or None for a single number.
        wanted: paths; one that ends in a message means its x, y, z (and w); `[:]` or `[2:5]` mean several elements,
            `[name=value]` the one whose text of that name is this.
        texts: the texts of the message by path.

    Raises:
        PathError: there is no such number.
        ElementMissing: no element of an array has that text.
    """
    wanted = tuple(_selected(path, texts or {}) for path in wanted)
    picks = tuple(pick for path in wanted for pick in _find(known, path.strip()))
    if not picks:
        raise PathError(f"'{', '.join(wanted)}' names no element")
    return picks


def _selected(path: str, texts: Mapping[str, tuple[str, ...]]) -> str:
    """The path with the index of an element in place of the text that it is known by."""
    match = _SELECT.search(path)
    if match is None:
        return path
    before, name, value = path[: match.start()], match["name"], match["value"].strip()
    element = re.compile(re.escape(before) + r"\[(\d+)\]\." + re.escape(name))
    found = []
    for known, here in texts.items():
        place = element.fullmatch(known)
        if place is not None:
            found.append(here[0])
            if here[0].removeprefix("/") == value.removeprefix("/"):
                return f"{before}[{place[1]}]{path[match.end() :]}"
    raise ElementMissing(f"no '{before}' with {name} '{value}'; there is: {', '.join(found[:_LISTED]) or 'none'}")


def _find(known: Mapping[str, int | None], path: str) -> list[Pick]:
    if path in known:
        return [Pick(path)]
    match = _RANGE.search(path)
    if match is not None:
        return _find_range(known, path, match)
    indexed = _INDEX.match(path)
    if indexed is not None and known.get(indexed["path"]) is not None:
        index, length = int(indexed["index"]), known[indexed["path"]] or 0
        if index >= length:
            raise PathError(f"no element {index} in '{indexed['path']}', which has {length}")
        return [Pick(indexed["path"], slice(index, index + 1))]
    for axes in reversed(_AXES):
        if all(f"{path}.{axis}" in known for axis in axes):
            return [Pick(f"{path}.{axis}") for axis in axes]
    raise PathError(f"no field '{path}'{_hint(path, known)}; the fields are: {_list(known)}")


def _find_range(known: Mapping[str, int | None], path: str, match: re.Match[str]) -> list[Pick]:
    before, after = path[: match.start()], path[match.end() :]
    start, stop = (int(text) if text else None for text in match.groups())
    length = known.get(before)
    if length is not None and not after:
        part = slice(*slice(start, stop).indices(length))
        if stop is not None and stop > length:
            raise PathError(f"'{path}' ends past the array, which has {length} elements")
        return [Pick(before, part)]
    elements = re.compile(re.escape(before) + r"\[(\d+)\]")
    count = len({m[1] for name in known if (m := elements.match(name))})
    if not count:
        raise PathError(f"no array '{before}'{_hint(before, known)}; the fields are: {_list(known)}")
    if stop is not None and stop > count:
        raise PathError(f"'{path}' ends past the array, which has {count} elements")
    indices = range(*slice(start, stop).indices(count))
    return [pick for index in indices for pick in _find(known, f"{before}[{index}]{after}")]


def _hint(path: str, known: Iterable[str]) -> str:
    close = close_names(path, known, most=2, cutoff=0.7)
    return f" (did you mean {', '.join(close)}?)" if close else ""


def _list(known: Mapping[str, int | None]) -> str:
    # One element stands for an array of messages.
    names = list(dict.fromkeys(re.sub(r"\[\d+\]", "[:]", name) for name in known))
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return (", ".join(names[:_LISTED]) + more) or "none"
