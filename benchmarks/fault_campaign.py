"""Thousands of runs, each with a fault: does every one end at the goal or in a named safe stop?

Run: ``python -m benchmarks.fault_campaign --runs 2000 --out runs/faults.jsonl``. The file gets a line for
every run as it ends, and the same command goes on where it was interrupted; ``--first K`` begins at another
row, so that two processes may each take a part into a file of its own, and ``--table FILE…`` prints the
table of them all.

Row k is the same in any order: even rows fly a free camera (`benchmarks.free_camera`: scenes drawn as a
study draws them, estimated to 1 cm, planned with 2 cm of room), odd rows move an RX60, a UR5e and a Panda
(`benchmarks.motion_faults`: planned with 2 cm of room for all bodies). All run in the loop that real arms
run in, `Supervisor` and `servo`, in simulated time, on projected points with 0.5 px of noise, the room
stated as ``path_room``. The faults are those of `benchmarks.planted_faults`, planted at 25 to 60% of the
time, in turn; one row in so many has none.

- **success**: the controller says that the goal image is reached, and the true points are within 5 px (rms)
  of it (where the target was nudged, those of where it is now);
- **named stop**: the robot was stopped by name; ``time_limit``: it was not at the goal 2 s after its time;
- **contact**: true bodies touched at any time, until it stands; **NaN**: a command was not finite;
  **untold**: the goal is said to be reached, and is not; **error**: an exception that is no stop. None of
  these may be.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import cache
from math import isfinite
from pathlib import Path

from benchmarks.free_camera import free_job
from benchmarks.motion_faults import ARMS, SEED, SOUND, Job, Outcome, jobs, outcome
from benchmarks.planted_faults import BORNE, FAULTS, Fault

from omniservo.robots import load_arm
from omniservo.safety import SafetyOptions

KINDS: tuple[Fault | None, ...] = (None, *FAULTS, *BORNE)
FREE, ARM = "free camera", "arm"
ARM_JOBS = 3
"""tasks of each arm that runs are drawn from; every turn through the faults has a new scene of its own for
the free camera"""

SAME_GOAL_PX = 5.0
SAFE = ("success", "named stop")
ENDS = (*SAFE, "contact", "NaN", "untold", "error")


@dataclass(frozen=True)
class Row:
    """What became of a run."""

    row: int
    world: str
    kind: str
    end: str
    """one of `ENDS`"""
    reason: str
    """name of the stop, or the exception"""
    distance: float | None
    """least between bodies [m]; None: an error, or nothing stands around"""


@cache
def _planning(name: str) -> tuple[list[Job], Iterator[Job]]:
    return [], jobs(load_arm(name), ARM_JOBS)


def arm_job(name: str, task: int) -> Job:
    """Return an arm's task, planned when it is first asked for."""
    planned, more = _planning(name)
    while len(planned) <= task:
        planned.append(next(more))
    return planned[task]


def run_row(number: int) -> Row:
    """Run a row; whatever goes wrong in it is a row, too."""
    turn, odd = divmod(number, 2)
    again, which = divmod(turn, len(KINDS))
    fault, world = KINDS[which], ARM if odd else FREE
    kind = "none" if fault is None else fault.name
    arm, task = ARMS[again % len(ARMS)], again // len(ARMS) % ARM_JOBS
    job = arm_job(arm, task) if odd else free_job(again)
    try:
        safety = SafetyOptions(path_room=job.room)
        found = outcome(job, SOUND[0], fault, (SEED, number), safety)
    except Exception as error:
        words = f"{type(error).__name__}: {error}"[:200]
        return Row(number, world, kind, "error", words, None)
    end, reason = ended(found)
    nearest = round(found.distance, 6) if isfinite(found.distance) else None
    return Row(number, world, kind, end, reason, nearest)


def ended(found: Outcome) -> tuple[str, str]:
    """Return how a run ended, the worst first, and the name of its stop."""
    if found.distance <= 0.0:
        return "contact", found.reason
    if not found.finite:
        return "NaN", found.reason
    if found.reason:
        return "named stop", found.reason
    return ("success" if found.goal_px <= SAME_GOAL_PX else "untold"), found.reason


def rows_of(file: Path) -> list[Row]:
    """Return the rows of a file; a last line that was cut off is left out."""
    if not file.exists():
        return []
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
    return [Row(**json.loads(line)) for line in lines if line.endswith("\n")]


def run_rows(numbers: Iterable[int], file: Path) -> None:
    """Run the rows that a file does not have yet, and add them."""
    there = rows_of(file)
    file.parent.mkdir(parents=True, exist_ok=True)
    text = "".join(json.dumps(asdict(row)) + "\n" for row in there)
    file.write_text(text, encoding="utf-8")
    known = {row.row for row in there}
    with file.open("a", encoding="utf-8") as stream:
        for number in numbers:
            if number not in known:
                stream.write(json.dumps(asdict(run_row(number))) + "\n")
                stream.flush()


def table(rows: list[Row]) -> Iterator[str]:
    """Yield the table by fault, and the sums."""
    yield "| fault | runs | at the goal | named stops | contact | NaN | untold | error | nearest [mm] |"
    yield "|---" * 9 + "|"
    by_kind: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        by_kind[row.kind].append(row)
    for kind in ("none" if fault is None else fault.name for fault in KINDS):
        if kind in by_kind:
            yield _line(kind, by_kind[kind])
    yield _line("all", rows)


def _line(kind: str, rows: list[Row]) -> str:
    ends = Counter(row.end for row in rows)
    stops = Counter(row.reason for row in rows if row.end == "named stop")
    named = ", ".join(f"`{reason}` {n}" for reason, n in stops.most_common()) or "–"
    distances = [1e3 * row.distance for row in rows if row.distance is not None]
    nearest = f"{min(distances):.1f}" if distances else "–"
    cells = [kind, len(rows), ends["success"], named, *(ends[end] for end in ENDS[2:]), nearest]
    return "| " + " | ".join(map(str, cells)) + " |"


def main() -> None:
    """Run the rows and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="row to begin with")
    parser.add_argument("--out", type=Path, default=Path("runs/faults.jsonl"))
    parser.add_argument("--table", type=Path, nargs="+", help="run nothing: the table of these files")
    given = parser.parse_args()
    if given.table is None:
        run_rows(range(given.first, given.first + given.runs), given.out)
    rows = [row for file in given.table or [given.out] for row in rows_of(file)]
    for line in table(sorted(rows, key=lambda row: row.row)):
        print(line)
    bad = [row for row in rows if row.end not in SAFE]
    for row in bad:
        print(f"\nrow {row.row}, {row.world}, {row.kind}: {row.end} {row.reason}")
    safe = 100.0 * (1.0 - len(bad) / max(len(rows), 1))
    print(f"\n{len(rows)} runs, {safe:.2f}% at the goal or in a named safe stop")


if __name__ == "__main__":
    main()
