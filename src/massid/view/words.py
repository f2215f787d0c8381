"""Names as words in pictures and in Markdown: whatever signs they hold, they are shown and do nothing."""

from __future__ import annotations

import re

from massid.errors import printable

_MARKDOWN = re.compile(r"[\\`*\[\]<>|&~!#$:]|(?<!\w)_|_(?!\w)")
"""Signs that can mean something in a cell; an underscore only where no letter stands on both of its sides."""


def in_picture(name: str) -> str:
    """A name for matplotlib, which takes what stands between dollars for mathematics."""
    return printable(name).replace("$", r"\$")


def in_markdown(name: str) -> str:
    """A name for a cell of a Markdown table."""
    return _MARKDOWN.sub(lambda match: f"\\{match[0]}", printable(name))
