"""Small drawings as SVG text: lines, bands, dots with error bars and paired bars on labelled axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from massid.markup import Markup, element
from massid.typing import FloatArray

WIDTH = 960.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 62.0, 16.0, 22.0, 34.0
_INK, _SOFT, _GRID = "#1d2229", "#5b6470", "#e3e7ec"
_NARROWEST, _SMALLEST = 1e-9, 1e-100
"""Axes that are narrower, as a share of where they are, or at all, have no ticks."""


class Chart:
    """One drawing with a horizontal and a vertical axis.

    Args:
        title: written above it.
        x: ends of the horizontal axis.
        y: ends of the vertical axis.
        height: in the units of the page; the width is `WIDTH`.
        left: width of the margin for labels.
        x_label: unit or name of the horizontal axis.
        numbered: whether the horizontal axis has numbers.
        names: of rows, for a chart whose vertical axis counts rows from the top; numbers are then left out.
    """

    def __init__(
        self,
        title: str,
        x: tuple[float, float],
        y: tuple[float, float],
        height: float = 240.0,
        left: float = _LEFT,
        x_label: str = "",
        numbered: bool = True,
        names: Sequence[str] = (),
    ) -> None:
        self._x, self._y, self._height, self._left = _widened(x), _widened(y), height, left
        self._parts: list[Markup] = []
        for tick in _ticks(*self._x) if numbered else []:
            across = self._across(tick)
            self._rule(across, _TOP, across, height - _BOTTOM, _GRID)
            self._text(across, height - _BOTTOM + 16.0, _number(tick), "middle")
        if names:
            for row, name in enumerate(names):
                self._text(left - 8.0, self._down(row) + 4.0, name, "end", _INK)
        else:
            for tick in _ticks(*self._y, count=5):
                down = self._down(tick)
                self._rule(left, down, WIDTH - _RIGHT, down, _GRID)
                self._text(left - 8.0, down + 4.0, _number(tick), "end")
        heading = {"x": f"{0 if names else left:.1f}", "y": "13", "fill": _INK, "font_weight": "600"}
        self._parts.append(element("text", title, **heading))
        self._text(WIDTH - _RIGHT, height - 3.0, x_label, "end")

    @classmethod
    def of_rows(
        cls, title: str, names: Sequence[str], x: tuple[float, float], x_label: str = "", row_height: float = 26.0
    ) -> Chart:
        """A chart with one row for each name."""
        height = _TOP + _BOTTOM + row_height * len(names)
        left = 24.0 + 7.2 * max(len(name) for name in names)
        return cls(title, x, (len(names) - 0.5, -0.5), height, left, x_label, names=names)

    def line(self, x: FloatArray, y: FloatArray, colour: str, width: float = 2.0, dashes: str = "") -> None:
        """Draw a line; it breaks where a value is not finite."""
        run: list[str] = []
        for across, down in zip(x.tolist(), y.tolist(), strict=True):
            if np.isfinite(down):
                run.append(f"{self._across(across):.1f},{self._down(down):.1f}")
            else:
                self._polyline(run, colour, width, dashes)
                run = []
        self._polyline(run, colour, width, dashes)

    def band(self, x: FloatArray, low: FloatArray, high: FloatArray, colour: str) -> None:
        """Fill between two lines."""
        there = [f"{self._across(a):.1f},{self._down(b):.1f}" for a, b in zip(x, high, strict=True)]
        back = [f"{self._across(a):.1f},{self._down(b):.1f}" for a, b in zip(x[::-1], low[::-1], strict=True)]
        self._parts.append(element("polygon", fill=colour, fill_opacity="0.15", points=" ".join(there + back)))

    def level(self, value: float, colour: str = _SOFT, upright: bool = False) -> None:
        """Draw a straight line through the chart at a value of one axis."""
        if upright:
            self._rule(self._across(value), _TOP, self._across(value), self._height - _BOTTOM, colour)
        else:
            self._rule(self._left, self._down(value), WIDTH - _RIGHT, self._down(value), colour)

    def dot(self, x: float, y: float, colour: str, radius: float = 4.0, hollow: bool = False, hint: str = "") -> None:
        """Draw a dot, with a hint that shows when the pointer rests on it."""
        place = {"cx": f"{self._across(x):.1f}", "cy": f"{self._down(y):.1f}", "r": f"{radius:.1f}"}
        look = {"fill": "white", "stroke": colour, "stroke_width": "2"} if hollow else {"fill": colour}
        self._parts.append(element("circle", *([element("title", hint)] if hint else []), **place, **look))

    def bar(self, low: float, high: float, y: float, colour: str, thick: float = 3.0, opacity: float = 1.0) -> None:
        """Draw a horizontal bar: an interval, or a length from zero."""
        start, end = self._across(low), self._across(high)
        place = {"x": f"{start:.1f}", "y": f"{self._down(y) - 0.5 * thick:.1f}", "rx": f"{min(1.5, 0.5 * thick):.1f}"}
        size = {"width": f"{max(end - start, 0.6):.1f}", "height": f"{thick:.1f}"}
        self._parts.append(element("rect", **place, **size, fill=colour, fill_opacity=f"{opacity:g}"))

    def tick(self, x: float, y: float, colour: str, size: float = 8.0) -> None:
        """Draw a short upright mark."""
        across, down = self._across(x), self._down(y)
        self._rule(across, down - size, across, down + size, colour, stroke_width="2")

    def note(self, x: float, y: float, text: str, colour: str = _SOFT) -> None:
        """Write beside a point."""
        self._text(self._across(x) + 8.0, self._down(y) + 4.0, text, "start", colour)

    def svg(self) -> Markup:
        """The drawing."""
        return element("svg", *self._parts, viewBox=f"0 0 {WIDTH:g} {self._height:g}", role="img")

    def _across(self, value: float) -> float:
        low, high = self._x
        return self._left + (WIDTH - _RIGHT - self._left) * min(max((value - low) / (high - low), 0.0), 1.0)

    def _down(self, value: float) -> float:
        low, high = self._y
        return _TOP + (self._height - _TOP - _BOTTOM) * min(max((high - value) / (high - low), 0.0), 1.0)

    def _polyline(self, run: Sequence[str], colour: str, width: float, dashes: str) -> None:
        if len(run) > 1:
            look = {"fill": "none", "stroke": colour, "stroke_width": f"{width:g}", "stroke_dasharray": dashes}
            self._parts.append(element("polyline", **look, points=" ".join(run)))

    def _rule(self, x1: float, y1: float, x2: float, y2: float, colour: str, **look: str) -> None:
        ends = {"x1": f"{x1:.1f}", "y1": f"{y1:.1f}", "x2": f"{x2:.1f}", "y2": f"{y2:.1f}"}
        self._parts.append(element("line", **ends, stroke=colour, **look))

    def _text(self, x: float, y: float, text: str, anchor: str, colour: str = _SOFT) -> None:
        self._parts.append(
            element("text", text, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor, fill=colour),
        )


def _widened(ends: tuple[float, float]) -> tuple[float, float]:
    low, high = ends
    size = max(abs(low), abs(high))
    if abs(high - low) > max(_NARROWEST * size, _SMALLEST):
        return low, high
    return low - max(1.0, size), high + max(1.0, size)


def _ticks(low: float, high: float, count: int = 8) -> list[float]:
    """Round numbers between two ends."""
    low, high = min(low, high), max(low, high)
    raw = (high - low) / count
    power = 10.0 ** np.floor(np.log10(raw))
    step = power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= raw)
    first = np.ceil(low / step - 1e-9)
    return [float(step * k) for k in np.arange(first, np.floor(high / step + 1e-9) + 1)]


def _number(value: float) -> str:
    return f"{0.0 if abs(value) < 1e-12 else value:.6g}"
