"""A finished figure as files."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from PIL import Image

from omniservo.files import write_whole
from omniservo.reporting.style import Drawing, styled

_DPI = 170

_QUALITY = 88
"""of WebP"""

_EFFORT = 4
"""of PNG's compression: half of the time of zlib's own choice, 6, for 5% more bytes"""


def image_bytes(drawing: Drawing, ending: str) -> bytes:
    """Return a figure as the bytes of a ``png``, ``svg`` or ``webp`` file; equal figures give equal bytes."""
    if ending not in drawing.saved:
        drawing.saved[ending] = _SAVED[ending](drawing)
    return drawing.saved[ending]


def _png(drawing: Drawing) -> bytes:
    stream = io.BytesIO()
    canvas: Any = FigureCanvasAgg(drawing.figure)
    with _drawn_once(drawing):
        canvas.draw()
    pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    pixels.save(stream, format="png", dpi=(_DPI, _DPI), compress_level=_EFFORT)
    return stream.getvalue()


def _svg(drawing: Drawing) -> bytes:
    stream = io.BytesIO()
    with _drawn_once(drawing):
        canvas: Any = FigureCanvasSVG(drawing.figure)
        canvas.print_svg(stream, metadata={"Date": None})
    return stream.getvalue()


def _webp(drawing: Drawing) -> bytes:
    stream = io.BytesIO()
    Image.open(io.BytesIO(image_bytes(drawing, "png"))).save(stream, format="webp", quality=_QUALITY)
    return stream.getvalue()


_SAVED = {"png": _png, "svg": _svg, "webp": _webp}


@contextmanager
def _drawn_once(drawing: Drawing) -> Iterator[None]:
    """Draw in the figures' style and resolution; `Figure.savefig` would draw everything twice."""
    drawing.figure.dpi = _DPI
    with styled():
        yield
    drawing.figure.set_layout_engine("none")  # what was laid out for the first file holds for all


def write_drawings(drawings: Iterable[Drawing], folder: Path) -> list[Path]:
    """Write each figure as PNG and as SVG, replacing existing files; return the files written: all or none.

    Raises:
        InputError: the folder cannot be written.
    """
    written: list[Path] = []
    try:
        for drawing in drawings:
            for ending in ("png", "svg"):
                path = folder / f"{drawing.name}.{ending}"
                write_whole(path, image_bytes(drawing, ending), force=True)
                written.append(path)
    except BaseException:
        for path in written:
            path.unlink(missing_ok=True)
        raise
    return written
