"""How large a model may be: what a file of a few bytes can become is found before an engine makes it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from xml.parsers import expat

from massid.errors import ModelError

MOST_BODIES = 1000
"""A humanoid with hands has about a hundred, a room around it some more."""
MOST_ELEMENTS = 200_000
MOST_NUMBERS = 1e7
"""Of a height field, or of user data."""
_BODIES = ("body", "link")
_INCLUDES_DEEP = 10


def check_size(content: bytes, path: Path) -> None:
    """Pass if a model file, with the files that it includes, makes a model of bearable size; what is no XML passes.

    Raises:
        ModelError: it has too many bodies or elements, or asks for too large a field.
    """
    counter = _Counter(path)
    counter.read(content, 0)


class _Counter:
    """Counts what elements make, those that are replicated as often as they are."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.bodies = self.elements = 0.0
        self.times = [1.0]

    def read(self, content: bytes, depth: int) -> None:
        parser = expat.ParserCreate()
        parser.StartElementHandler = lambda tag, attributes: self.start(tag, attributes, depth)
        parser.EndElementHandler = lambda _: self.times.pop()
        before = len(self.times)
        try:
            parser.Parse(content, True)
        except expat.ExpatError:
            del self.times[before:]  # whoever reads the model says what is wrong with it

    def start(self, tag: str, attributes: Mapping[str, str], depth: int) -> None:
        times = self.times[-1]
        self.elements += times
        if tag in _BODIES:
            self.bodies += times
        if tag in ("replicate", "composite", "flexcomp"):
            copies = max(1.0, _product(attributes.get("count", "1")))
            times *= copies
            self.bodies += copies if tag != "replicate" else 0.0
        elif tag == "hfield":
            self.check("a height field", _product(f"{attributes.get('nrow', '0')} {attributes.get('ncol', '0')}"))
        elif tag == "size":
            for name in attributes.keys() - {"memory"}:
                self.check(f"the size {name}", _product(attributes[name]))
        elif tag == "include" and depth < _INCLUDES_DEEP:
            self.include(attributes.get("file", ""), depth)
        self.times.append(times)
        for count, most, what in (
            (self.bodies, MOST_BODIES, "bodies"),
            (self.elements, MOST_ELEMENTS, "elements"),
        ):
            if count > most:
                raise ModelError(f"{self.path}: has {count:.0f} {what} or more; massid takes robots of {most} at most.")

    def include(self, name: str, depth: int) -> None:
        file = self.path.resolve().parent / name
        try:
            content = file.read_bytes() if file.is_file() else b""
        except OSError:
            return
        self.read(content, depth + 1)

    def check(self, what: str, numbers: float) -> None:
        if not numbers <= MOST_NUMBERS:
            raise ModelError(f"{self.path}: {what} of {numbers:.3g} numbers; massid takes {MOST_NUMBERS:.0g} at most.")


def _product(text: str) -> float:
    try:
        return math.prod(float(word) for word in text.split())
    except (ValueError, OverflowError):
        return 1.0
