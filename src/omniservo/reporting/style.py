"""How every figure looks: colours that colour-blind readers tell apart, sizes; no pyplot."""

from __future__ import annotations

import io
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

EXECUTED = "#0b3c6f"
"""what the arm did"""
PLANNED = "#e08a00"
"""what the plan says"""
CERTIFIED = "#c1121f"
"""what the certificate guarantees; always dashed"""
REQUIRED = "#3d3d3d"
"""what the task requires; always dotted"""
START = "#d1001c"
"""the paper's red circles"""
GOAL = "#0050d8"
"""the paper's blue stars"""
OBSTACLE = "#8c3b24"
QUIET = "#8a8f98"
"""borders, and what only gives context"""
FORBIDDEN = "#f4e3e0"
"""ground on which a curve must not run"""
THREE = ("#0072b2", "#d55e00", "#009e73")
"""three components; Okabe and Ito's colours"""
SEVEN = ("#0072b2", "#d55e00", "#009e73", "#aa4499", "#56b4e9", "#6b5600", "#000000")
"""joints of an arm"""

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "axes.edgecolor": "#555a61",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e6ea",
    "grid.linewidth": 0.8,
    "legend.fontsize": 9.0,
    "legend.frameon": False,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "lines.linewidth": 1.8,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "text.usetex": False,  # names of joints and files are no formulas, whatever the user's own settings are
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "svg.hashsalt": "omniservo",
    "svg.fonttype": "path",
}


_HIGHEST = 4.0


@dataclass(frozen=True)
class Drawing:
    """A finished figure and what to look at in it."""

    name: str
    """of its files, without ending"""
    title: str
    caption: str
    """plain text"""
    figure: Figure
    is_picture: bool = False
    """mostly pixels or shaded surfaces: of these a page holds pixels, of all others lines"""
    saved: dict[str, bytes] = field(default_factory=dict, compare=False, repr=False)
    """files of it that were made, by their ending: a figure stands in its own file and in a report"""


def styled() -> AbstractContextManager[None]:
    """Return a context in which figures are drawn and saved; Matplotlib's own settings return after it."""
    return mpl.rc_context(_STYLE)


class _ShownFigure(Figure):
    """A figure that a notebook shows, though pyplot does not know it."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        canvas: Any = FigureCanvasAgg(self)
        with styled():
            canvas.print_png(stream)
        return stream.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of ``width`` × ``height`` [inch]; it belongs to no window and no global list.

    It is no higher than `_HIGHEST` times its width: a camera's file may state an image a pixel wide.
    """
    height = min(height, _HIGHEST * width)
    return _ShownFigure(figsize=(width, height), layout=ConstrainedLayoutEngine(h_pad=0.08, w_pad=0.06))


def new_axes(width: float, height: float) -> tuple[Figure, Axes]:
    """Return such a figure, and the one coordinate system in it."""
    figure = new_figure(width, height)
    return figure, figure.subplots()


def as_image(axes: Axes, width: int, height: int) -> None:
    """Show what lies in an image of that size [px] and a little beyond it, v downwards and without a grid."""
    edge = 0.02 * width
    axes.set_xlim(-edge, width + edge)
    axes.set_ylim(height + edge, -edge)
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel("u [px]")
    axes.set_ylabel("v [px]")


def legend_below(figure: Figure, axes: Axes, columns: int) -> None:
    """Put the legend of ``axes`` under the whole figure, where it covers nothing, in columns that fit it."""
    handles, labels = axes.get_legend_handles_labels()
    for count in range(columns, 0, -1):
        legend = figure.legend(handles, labels, loc="outside lower center", ncols=count)
        if count == 1 or legend.get_window_extent().width <= figure.bbox.width:
            break
        legend.remove()
