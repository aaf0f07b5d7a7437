"""A figure in a report's page: its picture, its title and what it shows."""

from __future__ import annotations

from typing import Literal

from omniservo.reporting.figure_files import image_bytes
from omniservo.reporting.html import Markup, inlined, tag
from omniservo.reporting.style import Drawing


def framed(drawing: Drawing, width: Literal["half", "wide"]) -> Markup:
    """Return the figure with its caption, as wide as the page or half of it."""
    words = tag("figcaption", tag("strong", f"{drawing.title}. "), drawing.caption)
    return tag("figure", inlined(image_bytes(drawing, "png"), "png", drawing.title), words, class_=width)
