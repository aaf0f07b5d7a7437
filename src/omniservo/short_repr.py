"""A value in one line."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

_MOST = 150
"""characters of fields; what comes after is left out"""
_LONG = 40
"""characters of one field; of a longer one only kind and size are stated"""

_FEW = 4
"""numbers that are written out"""


def short_repr(value: Any) -> str:
    """Return a dataclass in one line of at most about 200 characters, to be its ``__repr__``.

    A field that is long, such as an array, is stated by its kind and size, an empty one not at all; the
    last ones may be left out.
    """
    words: list[str] = []
    for field in fields(value):
        held = getattr(value, field.name)
        if field.repr and held is not None and not (isinstance(held, tuple) and not held):
            words.append(f"{field.name}={_in_short(held)}")
        if sum(map(len, words)) > _MOST:
            words[-1] = "…"
            break
    return f"{type(value).__name__}({', '.join(words)})"


def _in_short(value: object) -> str:
    """Return a field's value, or its kind and size where that is long."""
    shape = getattr(value, "shape", None)
    if shape is not None and len(shape) == 1 and shape[0] <= _FEW:
        return f"({', '.join(f'{number:.6g}' for number in value)})"  # type: ignore[attr-defined]
    if shape is not None:
        return f"<{' × '.join(map(str, shape)) or type(value).__name__}>"
    if isinstance(value, float):
        return repr(value) if len(repr(value)) < 9 else f"{value:.6g}"
    written = repr(value)
    if len(written) <= _LONG and "\n" not in written:
        return written
    if isinstance(value, str):
        return f"{written[: _LONG - 1]}…"
    return f"<{len(value)}>" if isinstance(value, tuple | list | dict) else f"<{type(value).__name__}>"
