"""XML of unknown origin, as plain elements: no document types, no entities, bounded in depth."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree as ET
from xml.parsers import expat

from omniservo.errors import InputError

_MAX_DEPTH = 100
_MAX_ELEMENTS = 50_000
_TEXT_AT_ONCE = 2**20


_LATE_DECLARATION = re.compile(r"\A\s+<\?xml[^>]*\?>")
"""<?xml … ?> behind blanks or lines, which many programs read and the standard forbids"""


class XmlElement(ET.Element):
    """An element of the standard library that knows where it stands."""

    source: str = ""
    """of which text: its file"""
    line: int = 0
    """of that text, where it begins"""
    parent: XmlElement | None = None


def parse_elements(text: str, source: str) -> XmlElement:
    """Return the root element of XML text.

    Document types are refused, and with them entities and everything else that could refer or grow.

    Args:
        text: of the file.
        source: stands first in messages.

    Raises:
        InputError: not XML, with a document type, nested deeper than 100, or more than 50 000 elements; with
            the line.
    """
    parser = expat.ParserCreate()
    parser.buffer_text, parser.buffer_size = True, _TEXT_AT_ONCE
    builder = _Builder(parser, source)
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.words
    parser.StartDoctypeDeclHandler = builder.refuse
    try:
        parser.Parse(_LATE_DECLARATION.sub(_newlines, text, count=1), True)
    except expat.ExpatError as error:
        raise InputError(f"{source}: line {error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    return builder.root


def _newlines(found: re.Match[str]) -> str:
    """Return as many lines as were found, so that those that follow keep their numbers."""
    return "\n" * found[0].count("\n")


class _Builder:
    """Puts elements into each other as the parser meets them."""

    def __init__(self, parser: expat.XMLParserType, source: str) -> None:
        self._parser = parser
        self._source = source
        self._open = [XmlElement("document")]
        self._count = 0

    @property
    def root(self) -> XmlElement:
        return next(child for child in self._open[0] if isinstance(child, XmlElement))

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if len(self._open) > _MAX_DEPTH:
            raise InputError(f"{self._place()}: nested deeper than {_MAX_DEPTH}")
        if self._count > _MAX_ELEMENTS:
            raise InputError(f"{self._place()}: more than {_MAX_ELEMENTS} elements")
        element = XmlElement(tag, attributes)
        element.source, element.line = self._source, self._parser.CurrentLineNumber
        element.parent = self._open[-1]
        self._open[-1].append(element)
        self._open.append(element)

    def end(self, tag: str) -> None:
        self._open.pop()

    def words(self, words: str) -> None:
        if not len(self._open[-1]):  # what stands between and behind children is nobody's text
            self._open[-1].text = (self._open[-1].text or "") + words

    def refuse(self, *_: Any) -> None:
        raise InputError(f"{self._place()}: document types (DOCTYPE) are not read")

    def _place(self) -> str:
        return f"{self._source}: line {self._parser.CurrentLineNumber}"
