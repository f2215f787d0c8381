"""A report that is printed section by section and can be kept as one HTML page with pictures."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massid.errors import BadInputError
from massid.typing import FloatArray

if TYPE_CHECKING:
    from massid.log import Walk

_POINTS = 800
_WIDTH, _HEIGHT, _MARGIN = 900, 180, 50
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:60rem;color:#222}"
    "table{border-collapse:collapse}td,th{padding:.15rem .8rem .15rem 0;text-align:left}"
    "th{border-bottom:1px solid #999}svg{display:block;margin:.5rem 0 1.2rem}"
)


class Page:
    """Prints what it is given, and remembers it as HTML."""

    def __init__(self, title: str) -> None:
        self._parts = [f"<h1>{html.escape(title)}</h1>"]

    def section(self, title: str, lines: Sequence[str]) -> None:
        """Add a title with lines of text."""
        from massid.cli.console import say

        say(f"\n{title}" if len(self._parts) > 1 else title)
        for line in lines:
            say(f"  {line}")
        items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
        self._parts.append(f"<h2>{html.escape(title)}</h2><ul>{items}</ul>")

    def table(self, title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a title with a table."""
        from rich.table import Table
        from rich.text import Text

        from massid.cli.console import OUT, say

        say(f"\n{title}" if len(self._parts) > 1 else title)
        table = Table(box=None, pad_edge=False, header_style="bold")
        for name in head:
            table.add_column(Text(name), overflow="fold")
        for row in rows:
            table.add_row(*(Text(cell) for cell in row))
        OUT.print(table)
        cells = "".join(f"<th>{html.escape(name)}</th>" for name in head)
        body = "".join("<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in row) + "</tr>" for row in rows)
        self._parts.append(f"<h2>{html.escape(title)}</h2><table><tr>{cells}</tr>{body}</table>")

    def plot_walk(self, walk: Walk) -> None:
        """Add pictures of the base, the contact forces and the torques over time."""
        time_s = walk.time_s
        force = np.linalg.norm(walk.wrench[:, :, :3], axis=2)
        self._parts.append("<h2>Over time</h2>")
        self._plot("base height [m]", time_s, walk.qpos[:, 2:3], [walk.root_body])
        self._plot("contact force [N]", time_s, force, list(walk.contact_bodies))
        size = np.argsort(-np.abs(walk.effort).mean(axis=0))[: len(_COLOURS)]
        names = [walk.joint_names[k] for k in size]
        self._plot("largest torques [N m]", time_s, walk.effort[:, size], names)
        self._plot("their joint positions [rad]", time_s, walk.qpos[:, 7 + size], names)

    def _plot(self, title: str, x: FloatArray, values: FloatArray, names: Sequence[str]) -> None:
        rows = np.linspace(0, len(x) - 1, min(_POINTS, len(x))).round().astype(int)
        x, values = x[rows], values[rows][:, : len(_COLOURS)]
        low, high = float(values.min()), float(values.max())
        low, high = (low, high) if high > low else (low - 1.0, high + 1.0)
        end = max(float(x[-1]), 1e-9)
        across = _MARGIN + (_WIDTH - _MARGIN) * x / end
        parts = [f'<text x="0" y="14">{html.escape(title)}</text>']
        for column, name in zip(values.T, names, strict=False):
            colour = _COLOURS[len(parts) // 2 % len(_COLOURS)]
            down = 24 + (_HEIGHT - 44) * (high - column) / (high - low)
            points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, down, strict=True))
            parts.append(f'<polyline fill="none" stroke="{colour}" points="{points}"/>')
            left = 170 + 120 * (len(parts) // 2)
            parts.append(f'<text x="{left}" y="14" fill="{colour}">{html.escape(name)}</text>')
        parts.append(f'<text x="0" y="34">{high:.4g}</text><text x="0" y="{_HEIGHT - 20}">{low:.4g}</text>')
        parts.append(f'<text x="{_MARGIN}" y="{_HEIGHT - 4}">0</text>')
        parts.append(f'<text x="{_WIDTH}" y="{_HEIGHT - 4}" text-anchor="end">{end:.4g} s</text>')
        self._parts.append(f'<svg width="{_WIDTH}" height="{_HEIGHT}" font-size="12">{"".join(parts)}</svg>')

    def write(self, path: Path) -> None:
        """Write the page.

        Raises:
            BadInputError: it cannot be written.
        """
        from massid.cli.console import say

        head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>massid</title><style>{_STYLE}</style>'
        try:
            path.write_text(f"{head}<body>{''.join(self._parts)}</body></html>\n", encoding="utf-8")
        except OSError as error:
            raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error
        say(f"\npage: {path}")
