"""A table that is printed, pasted into a document, and written as JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rich.table import Table


@dataclass(frozen=True)
class Sheet:
    """Text in rows and columns.

    Attributes:
        title: what was measured.
        header: of each column.
        rows: as many cells as there are columns in each.
    """

    title: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def rich(self) -> Table:
        """For a terminal."""
        table = Table(*self.header, title=self.title)
        for row in self.rows:
            table.add_row(*row)
        return table

    def markdown(self) -> str:
        """For a document."""
        lines = [self.header, ("---",) * len(self.header), *self.rows]
        return "\n".join([f"**{self.title}**", "", *(f"| {' | '.join(line)} |" for line in lines)])


def number(value: float | None) -> str:
    """Three digits, or a dash for what was not measured; large ones without exponent."""
    if value is None:
        return "-"
    return f"{value:.0f}" if 1000.0 <= abs(value) < 1e6 else f"{value:.3g}"


def as_markdown(sheets: Sequence[Sheet], machine: str) -> str:
    """All of a run as Markdown."""
    return "\n\n".join([machine, *(sheet.markdown() for sheet in sheets)]) + "\n"
