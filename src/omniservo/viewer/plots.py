"""Curves over w as lines in HTML: readable on a light and a dark page, in a page and in a file."""

from __future__ import annotations

from html import escape

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.spelling import significant, spell_bound
from omniservo.reporting.style import CERTIFIED, PLANNED
from omniservo.viewer.along_path import MarginCurve

_WIDTH, _HEIGHT = 300.0, 72.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 40.0, 6.0, 6.0, 14.0
_ROOM = 0.08
"""above and below a curve, in parts of its height"""


def plots_html(curves: list[MarginCurve], w: float) -> str:
    """Return one plot below the other, with a line at w."""
    return "".join(_plot(curve, w) for curve in curves) + (_LEGEND if curves else "")


_LEGEND = (
    f'<div style="font-size:11px;opacity:.8"><span style="color:{PLANNED}">━</span> along the path &nbsp; '
    f'<span style="color:{CERTIFIED}">╌</span> certified for every w &nbsp; ┄ required</div>'
)


def _plot(curve: MarginCurve, w: float) -> str:
    low, high = _range(curve)
    x = _LEFT + (_WIDTH - _LEFT - _RIGHT) * curve.w
    bottom = _HEIGHT - _BOTTOM

    def height(values: FloatArray) -> FloatArray:
        return bottom - (bottom - _TOP) * (values - low) / (high - low)

    lines = [f'<line x1="{_LEFT}" y1="{bottom}" x2="{_WIDTH - _RIGHT}" y2="{bottom}" stroke="currentColor"/>']
    for value, colour, dashes in (
        (curve.required, "currentColor", "1.5 3"),
        (curve.certified, CERTIFIED, "6 3"),
    ):
        if value is not None:
            y = float(height(np.array(value)))
            lines.append(
                f'<line x1="{_LEFT}" y1="{y:.1f}" x2="{_WIDTH - _RIGHT}" y2="{y:.1f}" stroke="{colour}" '
                f'stroke-width="1.6" stroke-dasharray="{dashes}"/>'
            )
    for run in _runs(np.stack([x, height(curve.values)], axis=-1)):
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in run)
        lines.append(f'<polyline points="{points}" fill="none" stroke="{PLANNED}" stroke-width="2"/>')
    at = _LEFT + (_WIDTH - _LEFT - _RIGHT) * w
    lines.append(
        f'<line x1="{at:.1f}" y1="{_TOP}" x2="{at:.1f}" y2="{bottom}" stroke="currentColor" opacity=".6"/>'
    )
    for value, anchor in ((low, bottom), (high, _TOP + 8.0)):
        lines.append(
            f'<text x="{_LEFT - 4}" y="{anchor}" text-anchor="end" font-size="10" fill="currentColor">'
            f"{significant(value)}</text>"
        )
    for place, word in ((0.0, "w 0"), (1.0, "1")):
        at = _LEFT + (_WIDTH - _LEFT - _RIGHT) * place
        lines.append(
            f'<text x="{at}" y="{_HEIGHT - 2}" text-anchor="middle" font-size="10" fill="currentColor">'
            f"{word}</text>"
        )
    return (
        f'<div style="font-size:12px;margin-top:4px">{_title(curve)}</div>'
        f'<svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" width="100%" role="img" '
        f'aria-label="{escape(curve.title)}">{"".join(lines)}</svg>'
    )


def _title(curve: MarginCurve) -> str:
    finite = curve.values[np.isfinite(curve.values)]
    least = f"least {significant(float(finite.min()))} {curve.unit}" if len(finite) else "not seen"
    proven = "" if curve.certified is None else f", certified {spell_bound(curve.certified, curve.unit)}"
    return f"<b>{escape(curve.title)}</b> {least}{proven}"


def _range(curve: MarginCurve) -> tuple[float, float]:
    """Return what the plot shows: all values, and what is required and certified."""
    bounds = [value for value in (curve.required, curve.certified) if value is not None]
    shown = [*curve.values[np.isfinite(curve.values)].tolist(), *bounds]
    low, high = (min(shown), max(shown)) if shown else (0.0, 1.0)
    room = _ROOM * max(high - min(low, 0.0), 1e-6)
    return min(low - room, 0.0) if low < 0.0 else 0.0, high + room


def _runs(points: FloatArray) -> list[FloatArray]:
    """Return the parts of a line (m, 2) that have numbers."""
    finite = np.isfinite(points).all(axis=1).astype(int)
    ends = np.flatnonzero(np.diff(np.concatenate([[0], finite, [0]]))).reshape(-1, 2)
    return [points[a:b] for a, b in ends if b - a >= 2]
