"""The page as one file that opens without Python: the scene that moves, verdict, curves and views."""

from __future__ import annotations

import base64
import io
from collections.abc import Callable
from html import escape

import numpy as np
from PIL import Image

from omniservo.geometry.arrays import ByteArray
from omniservo.viewer.answer import Answer
from omniservo.viewer.status import status_html

FRAMES = 61
"""of the motion"""

VIEWS = (0.0, 0.5, 1.0)
"""places of the path that the camera's view is kept of"""

_STYLE = (
    "body{margin:0;display:flex;height:100vh;font-family:system-ui,sans-serif;color:#1c1f24;background:#fff}"
    "iframe{flex:1;border:0;min-width:0}aside{width:330px;overflow:auto;padding:10px;box-sizing:border-box}"
    "aside{overflow-wrap:anywhere}@media (max-width:760px){body{flex-direction:column;height:auto}"
    "iframe{flex:none;width:100%;height:70vh}aside{width:auto}}"
    "img{width:100%;display:block;margin:8px 0 0}figcaption{font-size:11px}figure{margin:0}"
    "@media (prefers-color-scheme:dark){body{background:#1a1b1e;color:#d5d7db}}"
)


def replay_page(name: str, answer: Answer, scene: str, plots: str, seen: Callable[[float], ByteArray]) -> str:
    """Return the file.

    Args:
        name: of what is shown.
        answer: the planner's.
        scene: viser's own page of the recorded scene.
        plots: the curves.
        seen: from w to the camera's view (rows, columns, 3).
    """
    views = "".join(
        f'<figure><img alt="camera at w = {w:g}" src="{_data_uri(seen(w))}">'
        f"<figcaption>w = {w:g}</figcaption></figure>"
        for w in VIEWS
    )
    return (
        f"<!doctype html><html><head><meta charset='utf-8'><title>{escape(name)}: omniservo</title>"
        f"<style>{_STYLE}</style></head><body><iframe title='scene' srcdoc=\"{escape(scene)}\"></iframe>"
        f"<aside><h1 style='font-size:17px;margin:0 0 8px'>{escape(name)}</h1>"
        f"{status_html(answer)}{plots}{views}</aside></body></html>"
    )


def places_of_replay(answer: Answer) -> list[float]:
    """Return the places w that are recorded, as far as the shown path can be followed."""
    return [float(w) for w in np.linspace(0.0, answer.end, FRAMES)]


def _data_uri(image: ByteArray) -> str:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="JPEG", quality=80)
    return f"data:image/jpeg;base64,{base64.b64encode(buffer.getvalue()).decode('ascii')}"
