"""HTML and SVG as text: whatever is put into an element is escaped, unless it is an element itself."""

from __future__ import annotations

import html
from collections.abc import Iterable

from massid.errors import printable

_EMPTY = {"img", "meta"}
"""Elements of HTML that hold nothing and are not closed."""


class Markup(str):
    """Text that is HTML; any other text is words."""

    __slots__ = ()


def element(kind: str, *content: str, **attributes: str) -> Markup:
    """An element with its content.

    Args:
        kind: such as "td".
        content: elements, which stay as they are, and words, which are escaped.
        attributes: by name; ``class_`` is the class, ``font_weight`` is font-weight; empty ones are left out.
    """
    given = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{html.escape(printable(value))}"'
        for name, value in attributes.items()
        if value
    )
    return Markup(f"<{kind}{given}>" if kind in _EMPTY else f"<{kind}{given}>{joined(content)}</{kind}>")


def joined(content: Iterable[str]) -> Markup:
    """Elements and words one after the other, words escaped."""
    return Markup("".join(part if isinstance(part, Markup) else html.escape(printable(part)) for part in content))
