"""A page in one HTML file: headings, tables, cards and drawings, and pictures that lie beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

from massid.markup import Markup, element
from massid.outputs import write_file

Mood: TypeAlias = Literal["good", "bad", ""]
"""Whether what is said is welcome."""

_STYLE = """
:root{--ink:#1d2229;--soft:#5b6470;--line:#e3e7ec;--good:#0a8a78;--bad:#b4313f;--amber:#b36b00}
*{box-sizing:border-box}
body{font:15px/1.55 system-ui,"DejaVu Sans",sans-serif;color:var(--ink);margin:0 auto;max-width:66rem;
padding:2.2rem 1.4rem 4rem}
h1{font-size:1.6rem;margin:0 0 .2rem}h2{font-size:1.12rem;margin:2.4rem 0 .5rem}
h3{font-size:1rem;margin:1.8rem 0 .3rem}
p{margin:.3rem 0 .7rem;max-width:50rem}.soft{color:var(--soft)}ul{margin:.3rem 0;padding-left:1.2rem}
.cards{display:flex;flex-wrap:wrap;gap:.8rem;margin:1.2rem 0}
.card{border:1px solid var(--line);border-radius:10px;padding:.7rem 1rem;flex:1 1 11rem}
.card b{display:block;font-size:1.25rem;line-height:1.35}.card span{color:var(--soft);font-size:.85rem}
.good b{color:var(--good)}.bad b{color:var(--bad)}
.wide{overflow-x:auto}.wide+p,.wide+.wide{margin-top:.9rem}table{border-collapse:collapse;font-variant-numeric:tabular-nums}
td,th{padding:.25rem 1.3rem .25rem 0;text-align:left}
th{border-bottom:1px solid #9aa3ad;font-weight:600;font-size:.87rem;vertical-align:bottom}
td{border-bottom:1px solid var(--line);vertical-align:top}
td.n,th.n{text-align:right}td.n{white-space:nowrap}
td.good{color:var(--good);font-weight:600}td.bad{color:var(--bad);font-weight:600}
figure{margin:1rem 0 1.4rem}img{display:block;max-width:100%}figcaption{color:var(--soft);font-size:.87rem}
.warn{border-left:4px solid var(--amber);background:#fdf6ea;padding:.5rem .9rem;margin:.5rem 0;
border-radius:0 8px 8px 0}
svg{display:block;width:100%;height:auto;margin:.3rem 0 .6rem}svg text{font:12px system-ui,"DejaVu Sans",sans-serif}
.key{display:flex;flex-wrap:wrap;gap:.3rem 1.2rem;font-size:.87rem;color:var(--soft)}
.key i{display:inline-block;width:.8em;height:.8em;border-radius:50%;margin-right:.4em;vertical-align:-.05em}
"""


_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src 'self' file:; base-uri 'none'; form-action 'none'"
"""What a browser may do for a page: nothing but draw it, with its own styles and pictures that lie beside it."""


@dataclass(frozen=True)
class Cell:
    """One place in a table.

    Attributes:
        text: what stands there.
        mood: whether it is welcome.
    """

    text: str
    mood: Mood = ""


class HtmlPage:
    """Collects the parts of a page; all words given to it are escaped.

    Args:
        title: of the page.
    """

    def __init__(self, title: str) -> None:
        self._title = title
        self._parts = [element("h1", title)]

    def heading(self, text: str) -> None:
        """Begin a section."""
        self._parts.append(element("h2", text))

    def subheading(self, text: str) -> None:
        """Begin a part of a section."""
        self._parts.append(element("h3", text))

    def paragraph(self, *text: str, soft: bool = False) -> None:
        """Add a paragraph of words and elements; a soft one stands back."""
        self._parts.append(element("p", *text, class_="soft" if soft else ""))

    def bullets(self, lines: Sequence[str]) -> None:
        """Add a list."""
        self._parts.append(element("ul", *(element("li", line) for line in lines)))

    def warning(self, text: str) -> None:
        """Add a warning."""
        self._parts.append(element("div", text, class_="warn"))

    def cards(self, cards: Sequence[tuple[str, str, Mood]]) -> None:
        """Add a row of figures: value, what it is, and whether it is welcome."""
        found = [
            element("div", element("b", value), element("span", what), class_=f"card {mood}".rstrip())
            for value, what, mood in cards
        ]
        self._parts.append(element("div", *found, class_="cards"))

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str | Cell]]) -> None:
        """Add a table; columns that hold numbers only stand to the right."""
        cells = [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in rows]
        columns = list(zip(*cells, strict=True)) or [()] * len(head)
        kinds = ["n" if column and all(_is_number(cell.text) for cell in column) else "" for column in columns]
        top = [element("th", name, class_=kind) for kind, name in zip(kinds, head, strict=True)]
        body = [
            element(
                "tr",
                *(
                    element("td", cell.text, class_=f"{kind} {cell.mood}".strip())
                    for kind, cell in zip(kinds, row, strict=True)
                ),
            )
            for row in cells
        ]
        self._parts.append(element("div", element("table", element("tr", *top), *body), class_="wide"))

    def key(self, entries: Sequence[tuple[str, str]]) -> None:
        """Add a legend: colour and name."""
        found = [element("span", element("i", style=f"background:{colour}"), name) for colour, name in entries]
        self._parts.append(element("div", *found, class_="key"))

    def drawing(self, svg: Markup) -> None:
        """Add a drawing."""
        self._parts.append(svg)

    def picture(self, name: str, caption: str) -> None:
        """Add a picture that lies beside the page, with what it shows."""
        image = element("img", src=name, alt=caption)
        self._parts.append(element("figure", image, element("figcaption", caption)))

    def write(self, path: Path) -> None:
        """Write the page.

        Raises:
            BadInputError: it cannot be written.
        """
        head = (
            element("meta", charset="utf-8"),
            element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
            element("meta", name="viewport", content="width=device-width"),
            element("title", self._title),
            element("style", Markup(_STYLE)),
        )
        page = element("html", *head, element("body", *self._parts), lang="en")
        write_file(path, f"<!doctype html>{page}\n".encode())


def _is_number(cell: str) -> bool:
    return not cell.strip("0123456789.+-±e% –") and cell != ""
