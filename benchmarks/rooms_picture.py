"""The rooms of the package by the layers that import-linter holds, drawn for docs/architecture.md."""

from __future__ import annotations

import tomllib
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from omniservo.reporting.style import QUIET, SEVEN, new_figure

ROOT = Path(__file__).resolve().parents[1]

_WIDE, _HIGH = 2.0, 0.62
"""of a room's box"""


def draw_rooms() -> Figure:
    """Draw one row a layer; a room imports those of rows below its own."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    layers = [[name.strip() for name in layer.split("|")] for layer in contracts[0]["layers"]]
    alone = contracts[1]["source_modules"]
    most = max(map(len, layers))
    figure = new_figure(1.75 * (most + 1.3), 0.4 * len(layers))
    axes = figure.subplots()
    for row, layer in enumerate(layers):
        for column, room in enumerate(layer):
            _room(axes, _WIDE * (column + 0.5 * (most - len(layer))), -row, room)
    for room in alone:
        _room(axes, _WIDE * (most + 0.25), -0.5 * len(layers), room)
    axes.text(
        _WIDE * (most + 0.72), -0.5 * len(layers) - 0.75, "imports nothing\nof ours", ha="center", va="top"
    )
    axes.annotate(
        "", (-0.4, -len(layers) + 1.0), (-0.4, 0.0), arrowprops={"arrowstyle": "-|>", "color": QUIET}
    )
    axes.text(-0.55, -0.5 * len(layers), "imports point downwards", rotation=90, ha="center", va="center")
    axes.set(xlim=(-0.8, _WIDE * (most + 1.3)), ylim=(-len(layers) + 0.4, 0.6))
    axes.axis("off")
    return figure


def _room(axes: Axes, x: float, y: float, module: str) -> None:
    """Draw a room; what is one file is grey."""
    place = ROOT / "src" / Path(*module.split("."))
    colour = SEVEN[0] if place.is_dir() else QUIET
    corner = (x, y - 0.5 * _HIGH)
    axes.add_patch(
        FancyBboxPatch(
            corner, _WIDE - 0.12, _HIGH, "round,pad=0,rounding_size=0.12", fc=colour, ec=colour, alpha=0.22
        )
    )
    name = module.partition(".")[2]
    axes.text(x + 0.5 * (_WIDE - 0.12), y, name, ha="center", va="center", fontsize=9)
