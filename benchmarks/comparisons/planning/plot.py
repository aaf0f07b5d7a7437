"""Success against time, one panel a set."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from benchmarks.comparisons.planning.sets import PAPER
from benchmarks.comparisons.planning.summary import Summary

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

STYLES = {
    "first": ("#000000", "-", 2.2),
    "effort": ("#0072B2", "-", 2.2),
    "best": ("#56B4E9", "-", 1.6),
    "paper-compiled": ("#D55E00", "-", 1.4),
    "paper-numpy": ("#D55E00", "--", 1.4),
    "slsqp-margin": ("#009E73", "-", 1.4),
    "snopt-margin": ("#CC79A7", "-", 1.4),
    "snopt-first": ("#CC79A7", "--", 1.4),
    "ipopt-first": ("#E69F00", "-", 1.4),
    "rrtconnect": ("#666666", "-", 1.4),
    "rrtconnect-numpy": ("#666666", "--", 1.4),
}
"""Method → colour (Okabe and Ito: told apart by colour-blind readers), line, width; no others are drawn."""


def plot_success(found: Sequence[Summary], folder: Path) -> list[Path]:
    """Write ``benchmark-planning.png`` and ``.svg`` into ``folder``; return their paths."""
    mpl.rcParams["svg.hashsalt"] = "benchmark-planning"  # the same picture is the same file
    names = [name for name in dict.fromkeys(s.set for s in found) if name != PAPER]
    columns = min(4, len(names) + 1)
    lines = -(-(len(names) + 1) // columns)
    figure, axes = plt.subplots(
        lines, columns, figsize=(3.4 * columns, 2.9 * lines), squeeze=False, layout="constrained"
    )
    drawn: dict[str, object] = {}
    for panel, name in zip(axes.flat, names, strict=False):
        _panel(panel, name, [s for s in found if s.set == name], drawn)
    for panel in axes[:, 0]:
        panel.set_ylabel("feasible, of solvable [%]")
    for panel in axes.flat[len(names) :]:
        panel.axis("off")
    axes.flat[len(names)].legend(drawn.values(), drawn.keys(), loc="center", frameon=False, fontsize=9)
    paths = [folder / f"benchmark-planning.{kind}" for kind in ("png", "svg")]
    for path in paths:
        figure.savefig(path, dpi=150, metadata={"Date": None} if path.suffix == ".svg" else None)
    plt.close(figure)
    return paths


def _panel(panel: Axes, name: str, found: Sequence[Summary], drawn: dict[str, object]) -> None:
    for summary in found:
        if summary.method.name not in STYLES or not summary.solvable:
            continue
        colour, dash, width = STYLES[summary.method.name]
        part = 100.0 * np.arange(1, len(summary.times) + 1) / summary.solvable
        x = np.append(np.repeat(1e3 * summary.times, 2), 1e5)
        y = np.concatenate([[0.0], np.repeat(part, 2)])
        (line,) = panel.plot(x, y, color=colour, linestyle=dash, linewidth=width)
        drawn.setdefault(summary.method.label, line)
    panel.set(xscale="log", xlim=(1e-2, 1e4), ylim=(0.0, 103.0), title=name, xlabel="time [ms]")
    panel.set_xticks(10.0 ** np.arange(-2, 5))
    panel.grid(visible=True, alpha=0.3)
