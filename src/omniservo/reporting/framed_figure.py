"""A figure in a report's page: its image, its title and what it shows."""

from __future__ import annotations

from typing import Literal

from omniservo.reporting.figure_files import image_bytes
from omniservo.reporting.html import Markup, enlargeable, tag
from omniservo.reporting.style import Drawing


def framed(drawing: Drawing, width: Literal["half", "wide"]) -> Markup:
    """Return the figure with its caption, as wide as the page or half of it."""
    words = tag("figcaption", tag("strong", f"{drawing.title}. "), drawing.caption)
    return tag("figure", in_page(drawing, drawing.title), words, class_=width)


def in_page(drawing: Drawing, alternative: str) -> Markup:
    """Return the figure's image as a page holds it: once, and enlarged on a click."""
    ending, kind = ("webp", "webp") if drawing.is_picture else ("svg", "svg+xml")
    width, height = drawing.figure.get_size_inches()
    return enlargeable(image_bytes(drawing, ending), kind, alternative, (float(width), float(height)))
