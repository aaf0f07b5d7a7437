"""The benchmark's page: targets, a table for each set, what was run where."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from pathlib import Path

import numpy as np
from benchmarks.comparisons.planning.dense_check import LOOKS
from benchmarks.comparisons.planning.methods import FOR_DENOMINATOR, Method
from benchmarks.comparisons.planning.runner import MANY, Row
from benchmarks.comparisons.planning.sets import CHECKSUMS, SIZES
from benchmarks.comparisons.planning.summary import OURS, Summary, quantile
from benchmarks.comparisons.planning.targets import Target

LIBRARIES = ("numpy", "scipy", "numba", "casadi", "drake", "ompl")

COLUMNS = (
    "method",
    "problems",
    "claimed",
    "feasible",
    "of solvable",
    "violated",
    "median [ms]",
    "p95 [ms]",
    "energy",
    "energy / ours: median, p95",
    "length [m]",
    "least g: median, smallest",
    "least margins [mm, px]",
)


def page(
    command: str,
    hardest: Mapping[str, tuple[int, float, str]],
    rows: Sequence[Row],
    found: Sequence[Summary],
    wanted: Iterable[Target],
    missing: Mapping[str, str],
) -> str:
    """Return the page as Markdown. ``hardest``: set → problems, straight path's failures, checksum."""
    parts = ["# Planning benchmark\n", where(command), _how(), "## Targets\n", _targets(wanted)]
    parts += ["![Success against time](images/benchmark-planning.svg)\n"]
    parts += ["## In short\n", "Feasible of the solvable problems; median time [ms].\n", _short(found)]
    for name, facts in hardest.items():
        parts += [f"## {name}\n", _set(name, facts, rows), _table([s for s in found if s.set == name])]
    parts += ["## Methods\n", _methods({s.method.name: s.method for s in found}.values(), missing)]
    wrong = [row for row in rows if row.score.defect]
    if wrong:
        parts.append("## Contradictions\n")
        parts += [f"- {row.set} {row.index}, {row.method}: {row.score.defect}\n" for row in wrong]
    return "\n".join(parts)


def where(command: str, libraries: tuple[str, ...] = LIBRARIES) -> str:
    """Return when, on what machine and with what versions a page was written."""
    versions = []
    for name in libraries:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    machine = f"{processor()}, {os.cpu_count()} cores (one used), {platform.system()}"
    with_these = f"Python {platform.python_version()}, {', '.join(versions)}"
    return f"Written by `{command}` on {date.today().isoformat()}: {machine}; {with_these}.\n"


def processor() -> str:
    """Return the processor's name."""
    information = Path("/proc/cpuinfo")
    for line in information.read_text().splitlines() if information.exists() else ():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _how() -> str:
    looks = f"{LOOKS:,}".replace(",", " ")
    return f"""\
Every problem is given to every method in one run, by turns. *Claimed*: by the method's own measure.
*Feasible*: a polynomial path is proven by certificate **and** verifier; a polyline shows no violation at
{looks} looks. *Violated*: claimed, but a w shows a violation (verifier, certificate, or {looks} looks).
*Of solvable*: feasible ones of the problems that any method, or ours with {FOR_DENOMINATOR} starts, solves. A
method given fewer problems than the set has got the first ones. Times are warm, on one core, of all calls,
failures included: `perf_counter` around solver or kernel, the building of a model not counted; where a call
is shorter than 20 ms, the median of repeated calls. *Energy*: ∫‖t″‖²/ℓ² + ‖φ″‖² dw, its median over
feasible paths; the ratio to {OURS!r} (ours, least effort) over problems that both solve. *Least g*: the
smallest of all constraints without dimension: of an image limit about radians, of a length over its
requirement. *Least margins*: the smallest proven margins beyond what is required. A dash instead of a time:
not tried, since too large (IPOPT, 10 000 rows). The kernels among the targets are measured before the
sets and after each (medians of 200 calls): others use the machine too, and its speed changes by the minute.
"""


def _targets(wanted: Iterable[Target]) -> str:
    lines = ["| figure | must | ambition | here | |", "|---|---|---|---|---|"]
    says = {True: "met", False: "**missed**", None: ""}
    lines += [f"| {t.figure} | {t.must} | {t.ambition} | {t.here} | {says[t.met]} |" for t in wanted]
    return "\n".join(lines) + "\n"


def _short(found: Sequence[Summary]) -> str:
    """Return a row for each method, a column for each set."""
    sets = list(dict.fromkeys(s.set for s in found))
    lines = ["| method | " + " | ".join(sets) + " |", "|---" * (len(sets) + 1) + "|"]
    for label in dict.fromkeys(s.method.label for s in found):
        by_set = {s.set: s for s in found if s.method.label == label}
        lines.append(f"| {label} | " + " | ".join(_cell(by_set.get(name)) for name in sets) + " |")
    return "\n".join(lines) + "\n"


def _cell(s: Summary | None) -> str:
    median = np.nan if s is None else quantile(s.seconds, 0.5)
    return "–" if s is None or np.isnan(median) else f"{100.0 * s.success:.1f}%, {number(1e3 * median)}"


def _set(name: str, facts: tuple[int, float, str], rows: Sequence[Row]) -> str:
    count, failing, digits = facts
    solvable = {row.index for row in rows if row.set == name and row.score.feasible}
    only = sum(row.score.feasible for row in rows if row.set == name and row.method == MANY)
    known = " (as published)" if digits in CHECKSUMS[name] else ""
    return (
        f"{count} of {SIZES[name]} problems, checksum `{digits}`{known}; the straight path violates a "
        f"constraint in {100 * failing:.1f}%. Solvable: {len(solvable)}, {only} of them by "
        f"{FOR_DENOMINATOR} starts only.\n"
    )


def _table(found: Sequence[Summary]) -> str:
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
    lines += ["| " + " | ".join(_cells(summary)) + " |" for summary in found]
    return "\n".join(lines) + "\n"


def _cells(s: Summary) -> Iterator[str]:
    yield s.method.label
    yield str(s.problems)
    yield str(s.claimed)
    yield str(s.feasible)
    yield f"{100.0 * s.success:.1f}%"
    yield str(s.violated)
    yield number(1e3 * quantile(s.seconds, 0.5))
    yield number(1e3 * quantile(s.seconds, 0.95))
    yield number(s.energy)
    ratios = quantile(s.ratios, 0.5), quantile(s.ratios, 0.95)
    yield "–" if np.isnan(ratios[0]) else f"{ratios[0]:.3f}, {ratios[1]:.3f}"
    yield number(s.length)
    yield "–" if not s.feasible else f"{s.least[0]:.2g}, {s.least[1]:.2g}"
    yield "–" if np.isnan(s.visibility) else f"{1e3 * s.clearance:.3f}, {s.visibility:.3f}"


def number(value: float) -> str:
    """Return a number with three digits that count."""
    if np.isnan(value):
        return "–"
    return f"{value:.0f}" if value >= 100.0 else f"{value:#.3g}".rstrip(".")


def _methods(methods: Iterable[Method], missing: Mapping[str, str]) -> str:
    lines = ["| method | constraints are evaluated in | time limit a problem [s] |", "|---|---|---|"]
    lines += [f"| {m.label} | {m.runs_in} | {m.budget:g} |" for m in methods]
    lines += [f"| {name} | not run: {reason} | |" for name, reason in missing.items()]
    return "\n".join(lines) + "\n"
