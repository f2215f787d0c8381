"""A result for people: the tables that a terminal and a notebook show, columns for a data frame, and a line or two."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from massid.markup import Markup, element
from massid.result.description import describe_links
from massid.result.posterior import INTERVAL_95

if TYPE_CHECKING:
    from massid.result.result import Result

Columns: TypeAlias = dict[str, list[str] | list[float] | list[bool]]
_TABLE = "border-collapse:collapse;margin:0 0 .6em;color:inherit"
_CELL = "padding:2px 14px 2px 0;border-bottom:1px solid rgba(127,127,127,.4)"
"""Grey lines and the colours of what is around: legible on any background."""


@dataclass(frozen=True)
class TextTable:
    """Rows of text; the first column names them.

    Attributes:
        head: names of the columns.
        rows: one for each thing.
        total: a last row that sums them up; None if there is nothing to say.
    """

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    total: tuple[str, ...] | None = None

    @property
    def all_rows(self) -> tuple[tuple[str, ...], ...]:
        """The rows and, if there is one, the total."""
        return self.rows if self.total is None else (*self.rows, self.total)


def mass_table(result: Result) -> TextTable:
    """Each link: nominal mass, estimate and, for a noisy log, half of its 95 % interval; then all of them together."""
    nominal, hidden, std = result.nominal_kg, result.hidden_links, result.std_kg
    rows = []
    for link, estimate in result.estimate_kg.items():
        seen = link not in hidden
        half = (_half(std[link], ".3f") if seen else "-",) if std else ()
        rows.append((link, f"{nominal[link]:.3f}", f"{estimate:.4f}" if seen else "not identifiable", *half))
    total, together = None, result.together
    if std and len(nominal) > 1 and together is not None:
        half = (_half(together.std_kg, ".3f"),)
        total = ("together", f"{together.nominal_kg:.3f}", f"{together.estimate_kg:.4f}", *half)
    head = ("link", "nominal [kg]", "estimate [kg]", *(("95 % [kg]",) if std else ()))
    return TextTable(head, tuple(rows), total)


def quantity_table(result: Result) -> TextTable:
    """Each quantity that was asked for besides masses of links, likewise, with its unit in the last column."""
    rows = []
    for one in result.quantities:
        shown = _half(one.std, ".4f") if one.identifiable and one.std is not None else "-"
        estimate = f"{one.estimate:.5f}" if one.identifiable else "not identifiable"
        rows.append((one.name, f"{one.nominal:.4f}", estimate, *((shown,) if result.uncertainty else ()), one.unit))
    head = ("also asked for", "model file", "estimate", *(("95 %",) if result.uncertainty else ()), "unit")
    return TextTable(head, tuple(rows))


def outcome(result: Result) -> str:
    """How it ended, in one line."""
    n = len(result.windows)
    one, many = ("dwell window", "dwell windows") if result.mode == "online" else ("pass", "passes")
    unit = f"{n} {one if n == 1 else many}" + ("" if result.mode == "online" else " over the log")
    speed = f"{result.log_s:.1f} s of walking in {result.wall_s:.1f} s"
    return f"{result.status} after {unit} ({speed})"


def one_or_two_lines(result: Result) -> str:
    """How it ended, and each link with its 95 % interval."""
    std, hidden = result.std_kg, result.hidden_links
    masses = []
    for link, estimate in result.estimate_kg.items():
        half = f" {_half(std[link], '.2g')}" if std else ""
        masses.append(f"{link} not identifiable" if link in hidden else f"{link} {estimate:.3f}{half} kg")
    return f"Result: {outcome(result)}\n{', '.join(masses)}{' (+-: 95 %)' if std else ''}"


def columns(result: Result) -> Columns:
    """See `Result.table`."""
    links = describe_links(result)
    entries = links.values()
    intervals = [entry.interval95_kg or (math.nan, math.nan) for entry in entries]
    return {
        "link": list(links),
        "nominal_kg": [entry.nominal_kg for entry in entries],
        "estimate_kg": [_number(entry.estimate_kg) for entry in entries],
        "std_kg": [_number(entry.std_kg) for entry in entries],
        "low95_kg": [low for low, _ in intervals],
        "high95_kg": [high for _, high in intervals],
        "identifiable": [entry.identifiable for entry in entries],
    }


def notebook_html(result: Result) -> str:
    """The tables and how it ended, for a notebook: no scripts, no style sheet, no colours."""
    parts = [_html(mass_table(result))]
    if result.quantities:
        parts.append(_html(quantity_table(result)))
    count = len(result.warnings)
    warned = f"; {count} warning{'s' if count > 1 else ''} in .warnings" if count else ""
    return element("div", *parts, element("p", f"{outcome(result)}{warned}"))


def _html(table: TextTable) -> Markup:
    """Numbers stand to the right."""
    styles = [f"{_CELL};text-align:{'left' if name in (table.head[0], 'unit') else 'right'}" for name in table.head]

    def row(kind: str, cells: Sequence[str]) -> Markup:
        return element("tr", *(element(kind, cell, style=style) for cell, style in zip(cells, styles, strict=True)))

    rows = [row("td", [cells[0], *(cell.replace("+-", "±") for cell in cells[1:])]) for cells in table.all_rows]
    return element("table", row("th", table.head), *rows, style=_TABLE)


def _half(std: float, digits: str) -> str:
    return f"+-{INTERVAL_95 * std:{digits}}"


def _number(value: float | None) -> float:
    return math.nan if value is None else value
