"""A page that needs nothing but itself: headings, tables, cards and drawings in one HTML file."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path

from massid.errors import BadInputError

_STYLE = """
:root{--ink:#1d2229;--soft:#5b6470;--line:#e3e7ec;--good:#0a8a78;--bad:#b4313f;--amber:#b36b00}
*{box-sizing:border-box}
body{font:15px/1.55 system-ui,"DejaVu Sans",sans-serif;color:var(--ink);margin:0 auto;max-width:66rem;
padding:2.2rem 1.4rem 4rem}
h1{font-size:1.6rem;margin:0 0 .2rem}h2{font-size:1.12rem;margin:2.4rem 0 .5rem}
p{margin:.3rem 0 .7rem;max-width:50rem}.soft{color:var(--soft)}ul{margin:.3rem 0;padding-left:1.2rem}
.cards{display:flex;flex-wrap:wrap;gap:.8rem;margin:1.2rem 0}
.card{border:1px solid var(--line);border-radius:10px;padding:.7rem 1rem;flex:1 1 11rem}
.card b{display:block;font-size:1.25rem;line-height:1.35}.card span{color:var(--soft);font-size:.85rem}
.good b{color:var(--good)}.bad b{color:var(--bad)}
.wide{overflow-x:auto}table{border-collapse:collapse;font-variant-numeric:tabular-nums}
td,th{padding:.25rem 1.3rem .25rem 0;text-align:left;white-space:nowrap}
th{border-bottom:1px solid #9aa3ad;font-weight:600;font-size:.87rem}td{border-bottom:1px solid var(--line)}
td.n,th.n{text-align:right}
.warn{border-left:4px solid var(--amber);background:#fdf6ea;padding:.5rem .9rem;margin:.5rem 0;
border-radius:0 8px 8px 0}
svg{display:block;width:100%;height:auto;margin:.3rem 0 .6rem}svg text{font:12px system-ui,"DejaVu Sans",sans-serif}
.key{display:flex;flex-wrap:wrap;gap:.3rem 1.2rem;font-size:.87rem;color:var(--soft)}
.key i{display:inline-block;width:.8em;height:.8em;border-radius:50%;margin-right:.4em;vertical-align:-.05em}
"""


class HtmlPage:
    """Collects the parts of a page; all text given to it is escaped.

    Args:
        title: of the page.
    """

    def __init__(self, title: str) -> None:
        self._title = html.escape(title)
        self._parts = [f"<h1>{self._title}</h1>"]

    def heading(self, text: str) -> None:
        """Begin a section."""
        self._parts.append(f"<h2>{html.escape(text)}</h2>")

    def paragraph(self, text: str, soft: bool = False) -> None:
        """Add a paragraph; a soft one stands back."""
        self._parts.append(f"<p{' class=soft' if soft else ''}>{html.escape(text)}</p>")

    def bullets(self, lines: Sequence[str]) -> None:
        """Add a list."""
        self._parts.append("<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in lines) + "</ul>")

    def warning(self, text: str) -> None:
        """Add a warning."""
        self._parts.append(f'<div class="warn">{html.escape(text)}</div>')

    def cards(self, cards: Sequence[tuple[str, str, str]]) -> None:
        """Add a row of figures: value, what it is, and "good", "bad" or ""."""
        self._parts.append(
            '<div class="cards">'
            + "".join(
                f'<div class="card {mood}"><b>{html.escape(value)}</b><span>{html.escape(what)}</span></div>'
                for value, what, mood in cards
            )
            + "</div>"
        )

    def table(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        """Add a table; columns that hold numbers only stand to the right."""
        columns = list(zip(*rows, strict=True)) or [()] * len(head)
        style = [' class="n"' if column and all(_is_number(cell) for cell in column) else "" for column in columns]
        top = "".join(f"<th{kind}>{html.escape(name)}</th>" for kind, name in zip(style, head, strict=True))
        body = "".join(
            "<tr>"
            + "".join(f"<td{kind}>{html.escape(cell)}</td>" for kind, cell in zip(style, row, strict=True))
            + "</tr>"
            for row in rows
        )
        self._parts.append(f'<div class="wide"><table><tr>{top}</tr>{body}</table></div>')

    def key(self, entries: Sequence[tuple[str, str]]) -> None:
        """Add a legend: colour and name."""
        self._parts.append(
            '<div class="key">'
            + "".join(
                f'<span><i style="background:{colour}"></i>{html.escape(name)}</span>' for colour, name in entries
            )
            + "</div>"
        )

    def drawing(self, svg: str) -> None:
        """Add a drawing as it is."""
        self._parts.append(svg)

    def write(self, path: Path) -> None:
        """Write the page.

        Raises:
            BadInputError: it cannot be written.
        """
        head = (
            f'<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
            f"<title>{self._title}</title><style>{_STYLE}</style>"
        )
        try:
            path.write_text(f"{head}<body>{''.join(self._parts)}</body></html>\n", encoding="utf-8")
        except OSError as error:
            raise BadInputError(f"Cannot write {path}: {error.strerror}.") from error


def _is_number(cell: str) -> bool:
    return not cell.strip("0123456789.+-±e% –") and cell != ""
