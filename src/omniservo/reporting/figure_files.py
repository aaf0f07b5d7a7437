"""A finished figure as files."""

from __future__ import annotations

import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from omniservo.files import write_whole
from omniservo.reporting.style import Drawing, styled

_DPI = 170

_SETTINGS: dict[str, dict[str, Any]] = {
    "png": {"metadata": {"Software": None}},
    "svg": {"metadata": {"Date": None}},
    "webp": {"pil_kwargs": {"quality": 88}},
}


def image_bytes(drawing: Drawing, ending: str) -> bytes:
    """Return a figure as the bytes of a ``png``, ``svg`` or ``webp`` file; equal figures give equal bytes."""
    if ending not in drawing.saved:
        drawing.saved[ending] = _saved(drawing, ending)
    return drawing.saved[ending]


def _saved(drawing: Drawing, ending: str) -> bytes:
    stream = io.BytesIO()
    with styled():
        drawing.figure.savefig(stream, format=ending, dpi=_DPI, **_SETTINGS[ending])
    drawing.figure.set_layout_engine("none")  # what was laid out for the first file holds for all
    return stream.getvalue()


def write_drawings(drawings: Iterable[Drawing], folder: Path) -> list[Path]:
    """Write each figure as PNG and as SVG, replacing existing files; return the files written.

    Raises:
        InputError: the folder cannot be written.
    """
    written = []
    for drawing in drawings:
        for ending in ("png", "svg"):
            path = folder / f"{drawing.name}.{ending}"
            write_whole(path, image_bytes(drawing, ending), force=True)
            written.append(path)
    return written
