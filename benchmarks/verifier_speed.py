"""Time of `verify_plan` on plans with nine points, by what the problem asks for.

Run: ``python -m benchmarks.verifier_speed``. A mapping in, the answer out; median and least of several calls.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import perf_counter
from typing import Any

import numpy as np
from benchmarks.planning_speed import shipped_problem

from omniservo.errors import InputError
from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan

FAR, LEAST = 0.35, 0.15
"""How far from the first camera the clouds' points lie [m], and from the path at least."""
CALLS = 7
Fields = dict[str, Any]
BALL = {"type": "sphere", "center": [-0.03, -0.065, 0.085], "radius": 0.01, "clearance": 0.02}
BOX = {
    "type": "box",
    "center": [0.03, -0.075, 0.1],
    "quaternion": [0.0, 0.0, 0.0, 1.0],
    "half_extents": [0.06, 0.01, 0.02],
    "clearance": 0.01,
}
SIGNS = [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
MESH = {
    "type": "mesh",
    "vertices": (np.array(BOX["center"]) + np.array(SIGNS) * BOX["half_extents"]).tolist(),
    "clearance": 0.01,
}
MOVING = {**BALL, "motion": [[0.02, 0.0], [0.0, 0.01], [-0.01, 0.0]]}
DISTORTION = [-0.08, 0.02, 1e-3, -5e-4]
MASK = [[[10.0, 10.0], [90.0, 10.0], [70.0, 80.0], [20.0, 70.0]]]


def cloud() -> Fields:
    """Return 10 000 points of radius 2 mm, behind the camera and beside it."""
    rng = np.random.default_rng(0)
    around = rng.normal(size=(40_000, 3))
    around *= (FAR + 0.3 * rng.random((40_000, 1))) / np.linalg.norm(around, axis=1)[:, None]
    behind = around[around[:, 2] < LEAST][:10_000]
    return {"type": "cloud", "points": behind.tolist(), "radius": 0.002, "clearance": 0.02}


def problems() -> Iterator[tuple[str, Fields]]:
    """Yield name and problem: the paper's first example, changed."""
    base = shipped_problem("paper-example-1").to_dict()
    lens = base["camera"]
    yield "fisheye", base
    yield "occlusion by a sphere", base | {"obstacles": [BALL], "occlusion": True}
    yield "box, with occlusion", base | {"obstacles": [BOX], "occlusion": True}
    yield "mesh, with occlusion", base | {"obstacles": [MESH], "occlusion": True}
    yield "cloud of 10 000, with occlusion", base | {"obstacles": [cloud()], "occlusion": True}
    yield "moving sphere, with occlusion", base | {"obstacles": [MOVING], "occlusion": True}
    distorted = lens | {"distortion": DISTORTION, "max_angle": None}
    yield "distorted", base | {"camera": distorted}
    yield "mask", base | {"camera": lens | {"mask": MASK}}


def row(name: str, fields: Fields) -> str:
    """Return a line of the table: the answer, the median and the least time [ms]."""
    try:
        document = plan_path(PlanningProblem.from_dict(fields)).to_dict()
    except InputError as error:
        return f"{name:<34} not planned: {error}"
    answer, times = verify_plan(document), []
    for _ in range(CALLS):
        before = perf_counter()
        verify_plan(document)
        times.append(1e3 * (perf_counter() - before))
    return f"{name:<34} {answer.status:<10} {np.median(times):8.1f} {min(times):8.1f}"


def main() -> None:
    """Print the table."""
    print(f"{'nine points':<34} {'answer':<10} {'ms':>8} {'least':>8}")
    for name, fields in problems():
        print(row(name, fields), flush=True)


if __name__ == "__main__":
    main()
