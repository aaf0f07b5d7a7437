"""Methods of values whose work stands in the room of figures, above them: loaded when they are called."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def drawn(function: str, value: object) -> Any:
    """Return what a function of `omniservo.reporting.values` makes of a value: a figure, or HTML.

    A value knows no room above its own; it is drawn where figures are, by name, so that nothing is imported
    for values that no one looks at.
    """
    return getattr(import_module("omniservo.reporting.values"), function)(value)
