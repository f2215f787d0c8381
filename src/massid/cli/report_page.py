"""A report that is printed section by section and can be kept as one HTML page with pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from massid.typing import FloatArray
from massid.view.chart import Chart
from massid.view.colours import LINK_COLOURS
from massid.view.page import HtmlPage

if TYPE_CHECKING:
    from massid.walk import Walk

_POINTS = 800
_LINES = 6


class Page:
    """Prints what it is given, and remembers it as HTML."""

    def __init__(self, title: str) -> None:
        self._page = HtmlPage(title)
        self._is_first = True

    def section(self, title: str, lines: Sequence[str]) -> None:
        """Add a title with lines of text."""
        from massid.cli.console import say

        self._heading(title)
        for line in lines:
            say(f"  {line}")
        self._page.bullets(lines)

    def table(self, title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a title with a table."""
        from rich.table import Table

        from massid.cli.console import OUT, cell

        self._heading(title)
        table = Table(box=None, pad_edge=False, header_style="bold")
        for name in head:
            table.add_column(cell(name), overflow="fold")
        for row in rows:
            table.add_row(*map(cell, row))
        OUT.print(table)
        self._page.table(head, rows)

    def plot_walk(self, walk: Walk) -> None:
        """Add pictures of the base, the contact forces and the torques over time."""
        time_s = walk.time_s
        force = np.linalg.norm(walk.wrench[:, :, :3], axis=2)
        self._page.heading("Over time")
        self._plot("base height [m]", time_s, walk.qpos[:, 2:3], [walk.root_body])
        self._plot("contact force [N]", time_s, force, list(walk.contact_bodies))
        size = np.argsort(-np.abs(walk.effort).mean(axis=0))[:_LINES]
        names = [walk.joint_names[k] for k in size]
        self._plot("largest torques [N m]", time_s, walk.effort[:, size], names)
        self._plot("their joint positions [rad]", time_s, walk.qpos[:, 7 + size], names)

    def write(self, path: Path) -> None:
        """Write the page.

        Raises:
            BadInputError: it cannot be written.
        """
        from massid.cli.console import say

        self._page.write(path)
        say(f"\npage: {path}")

    def _heading(self, title: str) -> None:
        from massid.cli.console import say

        say(title if self._is_first else f"\n{title}")
        self._is_first = False
        self._page.heading(title)

    def _plot(self, title: str, x: FloatArray, values: FloatArray, names: Sequence[str]) -> None:
        rows = np.linspace(0, len(x) - 1, min(_POINTS, len(x))).round().astype(int)
        x, values = x[rows], values[rows][:, :_LINES]
        ends = (float(values.min()), float(values.max()))
        chart = Chart(title, (0.0, max(float(x[-1]), 1e-9)), ends, 190.0, x_label="time [s]")
        colours = [LINK_COLOURS[k % len(LINK_COLOURS)] for k in range(values.shape[1])]
        for column, colour in zip(values.T, colours, strict=True):
            chart.line(x, column, colour, 1.5)
        self._page.drawing(chart.svg())
        self._page.key(list(zip(colours, names, strict=False)))
