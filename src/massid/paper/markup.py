"""Small pieces of the page: tables, pictures, counts in words."""

from __future__ import annotations

import html
from collections.abc import Iterable, Sequence

import numpy as np


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of plain text."""
    top = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{top}</tr>{body}</table>"


def picture(name: str, caption: str) -> str:
    """A picture that lies beside the page, with what it shows."""
    text = html.escape(caption)
    return f'<figure><img src="{name}" alt="{text}"><figcaption>{text}</figcaption></figure>'


def count(value: int | None) -> str:
    """A number of windows or iterations."""
    return "not reached" if value is None else str(value)


def spread(values: Sequence[int | None]) -> str:
    """Median, least and most of several counts, and how many never got there."""
    reached = [value for value in values if value is not None]
    if not reached:
        return "not reached"
    missed = f", {len(values) - len(reached)} not reached" if len(reached) < len(values) else ""
    return f"{int(np.median(reached))} ({min(reached)}-{max(reached)}){missed}"
