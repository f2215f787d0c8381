"""Whatever is put into an element shows up as it is, and cannot end the element or begin another."""

from __future__ import annotations

from html.parser import HTMLParser

from hypothesis import given
from hypothesis import strategies as st

from massid.errors import printable
from massid.markup import Markup, element

WORDS = st.text()
"""Also halves of characters, which no file can hold, and what no page should."""


class _Reader(HTMLParser):
    """What a browser would make of a text."""

    def __init__(self, markup: str) -> None:
        super().__init__()
        self.begun: list[tuple[str, list[tuple[str, str | None]]]] = []
        self.words = ""
        self.feed(markup)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.begun.append((tag, attrs))

    def handle_data(self, data: str) -> None:
        self.words += data


@given(WORDS, WORDS)
def test_words_are_read_as_they_may_be_shown(inside: str, hint: str) -> None:
    read = _Reader(element("td", element("b", inside), title=hint, class_="n"))
    assert read.words == printable(inside)
    given_hint = [("title", printable(hint))] if hint else []
    assert read.begun == [("td", [*given_hint, ("class", "n")]), ("b", [])]


def test_what_a_formatted_text_makes_of_an_element_is_words_again() -> None:
    """An element that was put into other words is no element any more: nobody checked those words."""
    bold = element("b", "x")
    assert isinstance(bold, Markup)
    assert element("p", f"{bold}<i>") == "<p>&lt;b&gt;x&lt;/b&gt;&lt;i&gt;</p>"
    assert element("p", bold + "<i>") == "<p>&lt;b&gt;x&lt;/b&gt;&lt;i&gt;</p>"


def test_elements_that_hold_nothing_are_not_closed() -> None:
    assert element("img", src="a.png", alt="") == '<img src="a.png">'
    assert element("line", stroke_width="2") == '<line stroke-width="2"></line>'
