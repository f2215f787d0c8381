"""XML as text with places in it: what is changed is changed where it stands, and every other byte stays."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import escape

from massid.errors import ModelError, printable

_ATTRIBUTE = r"""(\s+{name}\s*=\s*)("[^"]*"|'[^']*')"""


@dataclass
class Element:
    """An element and where it stands.

    Attributes:
        tag: its name.
        attributes: as parsed.
        parent: None for the root.
        children: elements in it.
        start: of its first tag, in bytes.
        opened: end of its first tag.
        closing: start of its last tag; the same as `opened` for an element that closes itself.
        end: of all of it.
        line: from 1.
    """

    tag: str
    attributes: dict[str, str]
    parent: Element | None
    start: int
    opened: int
    line: int
    closing: int = 0
    end: int = 0
    children: list[Element] = field(default_factory=list)

    def child(self, tag: str) -> Element | None:
        """The first element of this name right below."""
        return next((one for one in self.children if one.tag == tag), None)

    def all(self, *tags: str) -> Iterator[Element]:
        """Elements of these names at any depth, itself included; of any name if none is given."""
        if not tags or self.tag in tags:
            yield self
        for one in self.children:
            yield from one.all(*tags)


class XmlText:
    """An XML file whose elements can be given attributes, text before, after and inside, or be taken out.

    Attributes:
        root: as parsed; it does not show what was changed.

    Args:
        content: the file.
        source: its name, for messages.

    Raises:
        ModelError: it is no XML.
    """

    def __init__(self, content: bytes, source: str) -> None:
        self.source = source
        self._content = content
        self._attributes: dict[int, tuple[Element, dict[str, str | None]]] = {}
        self._cuts: list[tuple[int, int, bytes]] = []
        self._inside: dict[int, tuple[Element, bytes]] = {}
        self.root = self._parse()

    def _parse(self) -> Element:
        parser = expat.ParserCreate()
        stack: list[Element] = []
        roots: list[Element] = []

        def start(tag: str, attributes: dict[str, str]) -> None:
            at = parser.CurrentByteIndex
            parent = stack[-1] if stack else None
            one = Element(tag, attributes, parent, at, self._end_of_tag(at), parser.CurrentLineNumber)
            (parent.children if parent else roots).append(one)
            stack.append(one)

        def end(tag: str) -> None:
            del tag
            one = stack.pop()
            closes_itself = self._content[one.opened - 2 : one.opened] == b"/>"
            one.closing = one.opened if closes_itself else parser.CurrentByteIndex
            one.end = one.opened if closes_itself else self._content.index(b">", one.closing) + 1

        parser.StartElementHandler, parser.EndElementHandler = start, end
        try:
            parser.Parse(self._content, True)
        except expat.ExpatError as error:
            raise ModelError(f"{self.source}: not a model that can be read: {error}.") from error
        return roots[0]

    def _end_of_tag(self, at: int) -> int:
        """End of a tag that begins somewhere; quoted values may hold a >."""
        found = re.compile(rb"""<(?:[^"'>]|"[^"]*"|'[^']*')*>""").match(self._content, at)
        assert found is not None  # expat has read it
        return found.end()

    def set(self, element: Element, values: Mapping[str, str | None]) -> None:
        """Give an element attributes; None takes one out."""
        self._attributes.setdefault(element.start, (element, {}))[1].update(values)

    def remove(self, element: Element) -> None:
        """Take an element out."""
        self._cuts.append((element.start, element.end, b""))

    def replace(self, element: Element, text: str | bytes) -> None:
        """Put a text where an element is."""
        self._cuts.append((element.start, element.end, _bytes(text)))

    def insert_before_root(self, text: str) -> None:
        """Put a text before the first element, behind the declaration."""
        self._cuts.append((self.root.start, self.root.start, _bytes(text)))

    def insert_first(self, element: Element, text: str) -> None:
        """Put a text right behind the first tag of an element, on a line of its own as its first child stands."""
        before = self._inside.get(element.start, (element, b""))[1]
        self._inside[element.start] = (element, before + self._indent(element) + _bytes(text))

    def _indent(self, element: Element) -> bytes:
        """What stands between an element's first tag and its first child, if it is but space."""
        if element.children:
            space = self._content[element.opened : element.children[0].start]
            if space.isspace():
                return space[space.rfind(b"\n") :] if b"\n" in space else b""
        return b""

    def inside(self, element: Element) -> bytes:
        """What stands between the tags of an element, as it was."""
        return self._content[element.opened : element.closing]

    def render(self) -> bytes:
        """The file with its changes."""
        cuts = list(self._cuts)
        for start in {*self._attributes, *self._inside}:
            element, values = self._attributes.get(start, (None, {}))
            owner, text = self._inside.get(start, (None, b""))
            one = element or owner
            assert one is not None
            tag = _with_attributes(self._content[one.start : one.opened], values)
            if text and one.closing == one.opened:  # it closes itself
                tag, text = tag[:-2].rstrip() + b">", text + f"</{one.tag}>".encode()
            cuts.append((one.start, one.opened, tag + text))
        out, at = [], 0
        # What is put before an element comes first, and what takes out all of it goes before what changes its tag.
        for start, end, text in sorted(cuts, key=lambda cut: (cut[0], cut[1] > cut[0], -cut[1])):
            if start < at:
                continue  # inside something that was taken out
            out += [self._content[at:start], text]
            at = end
        return b"".join([*out, self._content[at:]])


def _with_attributes(tag: bytes, values: Mapping[str, str | None]) -> bytes:
    for name, value in values.items():
        pattern = re.compile(_ATTRIBUTE.format(name=re.escape(name)).encode())
        new = b"" if value is None else _quoted(value)
        found = pattern.search(tag)
        if found:
            tag = tag[: found.start()] + (found[1] + new if new else b"") + tag[found.end() :]
        elif new:
            close = len(tag) - (2 if tag.endswith(b"/>") else 1)
            head = tag[:close].rstrip()
            tag = head + b" " + name.encode() + b"=" + new + tag[close:]
    return tag


def _quoted(value: str) -> bytes:
    """A value in quotes; what is not ASCII is written by number, whatever the file's encoding."""
    return b'"' + escape(value, {'"': "&quot;"}).encode("ascii", "xmlcharrefreplace") + b'"'


def _bytes(text: str | bytes) -> bytes:
    return text if isinstance(text, bytes) else text.encode("ascii", "xmlcharrefreplace")


def comment(text: str) -> str:
    """A comment on a line of its own; XML has no way to write two hyphens in a row in one, nor one at its end."""
    return f"<!-- {re.sub('-(?=-|$)', '- ', printable(text))} -->\n"


def numbers(values: Iterable[float]) -> str:
    """Numbers with all their digits, as XML models write vectors."""
    return " ".join(repr(float(value)) for value in values)


def tag(name: str, values: Mapping[str, str]) -> str:
    """An element that holds nothing but attributes."""
    return f"<{name} {' '.join(f'{key}={_quoted(value).decode()}' for key, value in values.items())}/>"
