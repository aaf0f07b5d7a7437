"""Runs the planning benchmark.

Run: ``python -m benchmarks.comparisons.planning [--quick] [--sets …] [--methods …]``.

It writes ``benchmark-planning.md`` and ``images/benchmark-planning.{png,svg}`` into DIR, and every row as CSV
and JSON into ``runs/benchmark-planning``. DIR is ``docs`` for a full run, else ``runs/benchmark-planning``.
"""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from benchmarks.comparisons.planning.methods import Method, all_methods
from benchmarks.comparisons.planning.plot import plot_success
from benchmarks.comparisons.planning.report import page
from benchmarks.comparisons.planning.runner import Row, run_set
from benchmarks.comparisons.planning.scaling import Scaling
from benchmarks.comparisons.planning.sets import SIZES, checksum, problems, straight_is_good
from benchmarks.comparisons.planning.summary import summaries
from benchmarks.comparisons.planning.targets import targets

RUNS = Path("runs/benchmark-planning")

QUICK = 0.05
"""of the problems of every set, and of those that a slow peer is given"""

FEWEST = 5
"""problems, where a set has so many"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, write, and say where."""
    given = _parser().parse_args(arguments)
    methods, missing = all_methods()
    if given.methods:
        methods = [method for method in methods if method.name in given.methods]
    if given.quick:
        methods = [_fewer(method) for method in methods]
    names = given.sets or list(SIZES)
    full = not (given.quick or given.sets or given.methods or given.count)
    out = given.out or (Path("docs") if full else RUNS)
    begin = perf_counter()
    timed = Scaling()
    rows, hardest = _run(names, methods, given, timed)
    found = summaries(rows, methods)
    (out / "images").mkdir(parents=True, exist_ok=True)
    RUNS.mkdir(parents=True, exist_ok=True)
    _write_rows(rows)
    wanted = list(targets(rows, found, timed.passes))
    command = " ".join(["python -m benchmarks.comparisons.planning", *_said(given)])
    text = page(command, hardest, rows, found, wanted, missing)
    (out / "benchmark-planning.md").write_text(text, encoding="utf-8")
    plot_success(found, out / "images")
    print(text)
    print(f"{perf_counter() - begin:.0f} s; {out / 'benchmark-planning.md'}, {RUNS}/rows.csv")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="benchmarks.comparisons.planning", description=__doc__.splitlines()[0]
    )
    names = [method.name for method in all_methods()[0]]
    parser.add_argument("--quick", action="store_true", help="a twentieth of the problems")
    parser.add_argument("--sets", nargs="+", choices=list(SIZES), help="these sets only")
    parser.add_argument("--methods", nargs="+", choices=names, help="these methods only")
    parser.add_argument("--count", type=int, help="problems of a set at most")
    parser.add_argument("--out", type=Path, help="where the page and its images go")
    return parser


def _said(given: argparse.Namespace) -> list[str]:
    """Return the arguments that decide what is run."""
    said = ["--quick"] if given.quick else []
    for name in ("sets", "methods"):
        said += [f"--{name}", *getattr(given, name)] if getattr(given, name) else []
    return said + ([f"--count {given.count}"] if given.count else [])


def _fewer(method: Method) -> Method:
    most = None if method.most is None else max(3, int(QUICK * method.most))
    return replace(method, most=most)


def _run(
    names: Sequence[str], methods: Sequence[Method], given: argparse.Namespace, timed: Scaling
) -> tuple[list[Row], dict[str, tuple[int, float, str]]]:
    """Return all rows, and of each set its size, the part that a straight path fails, and its checksum."""
    rows: list[Row] = []
    hardest = {}
    timed.measure()
    for name in names:
        count = max(FEWEST, int(QUICK * SIZES[name])) if given.quick else SIZES[name]
        found = problems(name, min(count, given.count or count))
        failing = float(np.mean([not straight_is_good(one) for one in found]))
        hardest[name] = len(found), failing, checksum(found)
        begin = perf_counter()
        rows += run_set(name, methods, len(found))
        timed.measure()
        print(f"{name}: {len(found)} problems, {perf_counter() - begin:.0f} s", flush=True)
    return rows, hardest


def _write_rows(rows: Sequence[Row]) -> None:
    flat = [row.flat() for row in rows]
    fields = list(dict.fromkeys(key for row in flat for key in row))
    with (RUNS / "rows.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fields)
        writer.writeheader()
        writer.writerows(flat)
    (RUNS / "rows.json").write_text(json.dumps(flat, indent=0, default=float), encoding="utf-8")


if __name__ == "__main__":
    main()
