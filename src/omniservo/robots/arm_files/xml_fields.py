"""Attributes of an element as checked values."""

from __future__ import annotations

from omniservo.errors import InputError, spelled, spelled_name
from omniservo.files.xml_files import XmlElement
from omniservo.geometry.arrays import FloatArray, finite_array

_LARGEST = 1e6
"""no length, angle, mass or rate of an arm is larger, whatever its unit"""

_ODD = 1e9
"""stiffness of a drive is the largest number that makes sense in a model"""


class XmlFields:
    """Reads attributes of elements; every message names file, line, element and what is legal."""

    def place(self, element: XmlElement) -> str:
        """Return what stands first in messages about an element: file, line, its name or its owner's."""
        owner: XmlElement | None = element
        while owner is not None and owner.get("name") is None:
            owner = owner.parent
        named = "" if owner is None else f"{spelled_name(owner.tag)} {spelled(owner.get('name'))}"
        own = "" if owner is element else spelled_name(element.tag)
        return f"{element.source}: line {element.line}: {': '.join(filter(None, (named, own)))}"

    def text(self, element: XmlElement, attribute: str) -> str:
        """Return an attribute that must be there and not be empty."""
        value = element.get(attribute, "").strip()
        if not value:
            raise InputError(f"{self.place(element)}: {attribute}: missing")
        return value

    def numbers(self, element: XmlElement, attribute: str, count: int | None) -> FloatArray:
        """Return an attribute's numbers (count,), all finite and at most 10⁶ in size; None: any count."""
        words = self.text(element, attribute).split()
        name = f"{self.place(element)}: {attribute}"
        try:
            values = finite_array(name, [float(word) for word in words], (count,))
        except InputError:
            raise
        except ValueError:
            raise InputError(f"{name}: {spelled(' '.join(words))} given; legal: numbers") from None
        if abs(values).max() > _LARGEST:
            raise InputError(f"{name}: {abs(values).max():g} given; at most {_LARGEST:g} is legal")
        return values

    def positive(self, element: XmlElement, attribute: str, count: int | None) -> FloatArray:
        """Return numbers (count,) that are all greater than 0."""
        values = self.numbers(element, attribute, count)
        if values.min() <= 0.0:
            name = f"{self.place(element)}: {attribute}"
            raise InputError(f"{name}: {values.min():g} given; greater than 0 is legal")
        return values

    def sober(self, root: XmlElement) -> None:
        """Refuse NaN, infinity and numbers above 10⁹ in any attribute of any element."""
        for element in root.iter():
            if not isinstance(element, XmlElement):
                continue
            for name, value in element.attrib.items():
                words = value.split() if name != "name" else []
                odd = next((word for word in words if not _is_sober(word)), None)
                if odd is not None:
                    raise InputError(
                        f"{self.place(element)}: {name}: {spelled(odd)} given; legal: numbers up to {_ODD:g}"
                    )

    def only(self, element: XmlElement, tag: str) -> XmlElement | None:
        """Return the one child of this tag; None: there is none."""
        found = [child for child in element.findall(tag) if isinstance(child, XmlElement)]
        if len(found) > 1:
            raise InputError(f"{self.place(element)}: {len(found)} elements <{tag}>; legal: one")
        return found[0] if found else None

    def needed(self, element: XmlElement, tag: str, legal: str) -> XmlElement:
        """Return the one child of this tag, which must be there; ``legal``: what it looks like."""
        found = self.only(element, tag)
        if found is None:
            raise InputError(f"{self.place(element)}: no <{tag}>; legal: {legal}")
        return found

    def children(self, element: XmlElement, tag: str = "*") -> list[XmlElement]:
        """Return the children, or those of one tag."""
        return [child for child in element.findall(tag) if isinstance(child, XmlElement)]


def _is_sober(word: str) -> bool:
    try:
        return abs(float(word)) <= _ODD
    except ValueError:
        return True
