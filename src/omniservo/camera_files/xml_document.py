"""XML as fields: what a small, harmless file holds, with the line of each field."""

from __future__ import annotations

import re
from typing import Any

from omniservo.files.xml_files import XmlElement, parse_elements

_NUMBER = re.compile(
    r"[-+]?([0-9]+(\.[0-9]*)?|\.[0-9]+)(e[-+]?[0-9]+)?|[-+]?\.?(inf|infinity|nan)", re.IGNORECASE | re.ASCII
)
_SHORT_WHOLE = re.compile(r"[-+]?[1-9][0-9]{0,8}|0")


def parse_xml(text: str, source: str) -> tuple[dict[str, Any], dict[tuple[str | int, ...], int]]:
    """Return ``{root: content}`` and the line of every field, by its path.

    An element with elements inside is a dict; elements of one name beside each other, and OpenCV's ``_``, are
    a list; text is a number, a list of numbers, or a string without its quotes. Attributes of elements
    without text are fields too, with an ``@`` before their names.

    Document types are refused, and with them entities and everything else that could refer or grow.

    Raises:
        InputError: not XML, with a document type, or nested deeper than 32; with the line.
    """
    root = parse_elements(text, source)
    lines: dict[tuple[str | int, ...], int] = {}
    return {root.tag: _content(root, (root.tag,), lines)}, lines


def xml_text(fields: dict[str, Any], root: str) -> str:
    """Return fields as XML that `parse_xml` reads back: mappings, lists, numbers, strings without markup."""
    return f'<?xml version="1.0"?>\n{_element(root, fields, "")}'


def _element(tag: str, value: Any, indent: str) -> str:
    if isinstance(value, dict):
        inner = "".join(_element(name, held, indent + "  ") for name, held in value.items())
    elif isinstance(value, list) and any(isinstance(held, list) for held in value):
        inner = "".join(_element("_", held, indent + "  ") for held in value)
    else:
        words = value if isinstance(value, list) else [value]
        text = " ".join(word if isinstance(word, str) else repr(word) for word in words)
        return f"{indent}<{tag}>{text}</{tag}>\n"
    return f"{indent}<{tag}>\n{inner}{indent}</{tag}>\n"


def _content(
    element: XmlElement, path: tuple[str | int, ...], lines: dict[tuple[str | int, ...], int]
) -> Any:
    lines[path] = element.line
    children = [child for child in element if isinstance(child, XmlElement)]
    attributes = {f"@{name}": _value(said) for name, said in element.attrib.items()}
    if not children:
        return _value(element.text or "") if (element.text or "").strip() or not attributes else attributes
    names = [child.tag for child in children]
    if set(names) == {"_"}:
        return [_content(child, (*path, i), lines) for i, child in enumerate(children)]
    fields: dict[str, Any] = attributes
    for name in dict.fromkeys(names):
        same = [child for child in children if child.tag == name]
        if len(same) == 1:
            fields[name] = _content(same[0], (*path, name), lines)
        else:
            lines[(*path, name)] = same[0].line
            fields[name] = [_content(child, (*path, name, i), lines) for i, child in enumerate(same)]
    return fields


def _value(text: str) -> Any:
    words = text.split()
    values = [number_or_word(word) for word in words]
    if values and not any(isinstance(value, str) for value in values):
        return values[0] if len(values) == 1 else values
    return text.strip().strip('"')


def number_or_word(word: str) -> float | int | str:
    """Return the number that a word spells, also OpenCV's .Inf and .Nan, else the word."""
    if not _NUMBER.fullmatch(word):
        return word
    if _SHORT_WHOLE.fullmatch(word):
        return int(word)
    return float(word if word[-1] in ".0123456789" else word.replace(".", ""))
