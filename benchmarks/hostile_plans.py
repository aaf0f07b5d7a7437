"""Plan files of legal size that would take long: many numbers, long numbers, high degrees, deep bisection.

Run: ``python -m benchmarks.hostile_plans``. Prints the answers, and how long they take of the processor.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from time import process_time
from types import MappingProxyType
from typing import Any

import numpy as np

from omniservo.verification import verify_plan

TINY, HUGE = 2.0**-1070, 2.0**1000
LONG = (TINY, 1 / 3, HUGE)
Document = dict[str, Any]
LENS = {
    "model": "unified",
    "fx": 400.0,
    "fy": 410.0,
    "cx": 320.0,
    "cy": 240.0,
    "xi": 1.291,
    "width": 640,
    "height": 480,
}


def problem(**changes: Any) -> Document:
    """Return a problem that asks for little."""
    base = {
        "format": "omniservo.problem/1",
        "camera": LENS,
        "goal": {"translation": [0.1, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
        "clearance": 0.02,
        "degrees": {"rotation": 20, "translation": 20},
    }
    return base | changes


def stated(asked: Document, way: Document) -> Document:
    """Return the plan that claims nothing, but has a certificate: all that its problem asks for is judged."""
    return {
        "format": "omniservo.plan/1",
        "problem": asked,
        "status": "certified",
        "path": way,
        "certificate": {"constraints": [], "worst": None},
    }


def wild_path(rng: np.random.Generator, degree: int, *, long: bool) -> Document:
    """Rows of that degree; with ``long`` of numbers from one end of the floats to the other."""

    def rows(count: int) -> list[list[float]]:
        found = rng.normal(size=(count, degree + 1))
        if long:
            found *= rng.choice(LONG, size=found.shape)
        return found.tolist()

    return {"rotation": rows(4), "translation": rows(3)}


def wild(
    rng: np.random.Generator, degree: int, points: int, *, long: bool = True, **changes: Any
) -> Document:
    """Any path past any targets."""
    targets = rng.normal(size=(points, 3))
    if long:
        targets *= rng.choice(LONG, size=targets.shape)
    asked = problem(points=targets.tolist(), **changes)
    return stated(asked, wild_path(rng, degree, long=long))


def distorted(rng: np.random.Generator, long: bool = True) -> Document:
    """A distorted dead zone, of degree 10 in polynomials of degree 120, and a polygon of long numbers."""
    lens = LENS | {"xi": 0.9, "distortion": [-0.08, 0.02, 1e-3, TINY if long else 1e-4]}
    lens["dead_zone"] = {"center": [320.0, 240.0 + TINY], "radius": 10.0}
    document = wild(rng, 20, 2, long=long, camera=lens)
    angles = np.linspace(0, 2 * np.pi, 1000, endpoint=False)
    document["certificate"]["polygon"] = (0.3 * np.column_stack([np.cos(angles), np.sin(angles)])).tolist()
    return document


def many_clouds(rng: np.random.Generator, count: int = 200, points: int = 50) -> Document:
    """Every point near the path, so that each has to be judged by itself, and lines of sight."""
    obstacles = [
        {"type": "cloud", "points": (1e-3 * rng.normal(size=(points, 3))).tolist(), "radius": 1e-3}
        for _ in range(count)
    ]
    document = wild(rng, 2, 9, long=False, obstacles=obstacles, clearance=TINY, occlusion=True)
    document["path"]["translation"] = (1e-3 * rng.normal(size=(3, 3))).tolist()
    return document


def many_planes(rng: np.random.Generator, count: int = 3000) -> Document:
    """Pieces with ends of a thousand bits, for a box with axes of long numbers."""
    box = {
        "type": "box",
        "center": [HUGE, TINY, 0.1],
        "quaternion": [TINY, 0.6, 0.0, 0.8],
        "half_extents": [TINY, 1.0, 1.0],
    }
    document = wild(rng, 20, 9, obstacles=[box], occlusion=True)
    ends = [0.0, *(TINY * (k + 1) for k in range(count - 1)), 1.0]
    pieces = [[a, b, -1.0, TINY, 1 / 3] for a, b in pairwise(ends)]
    document["certificate"]["separators"] = [
        {"constraint": "clearance obstacle 0", "pieces": pieces},
        *({"constraint": "occlusion obstacle 0", "point": j, "pieces": pieces} for j in range(9)),
    ]
    return document


def many_meshes(rng: np.random.Generator, count: int = 60) -> Document:
    """Solids of a thousand vertices round the path, without planes."""
    obstacles = [
        {"type": "mesh", "vertices": rng.normal(size=(1000, 3)).tolist(), "clearance": 1.0}
        for _ in range(count)
    ]
    return wild(rng, 2, 9, long=False, obstacles=obstacles, occlusion=True)


def masks(rng: np.random.Generator) -> Document:
    """64 polygons of 64 corners of long numbers."""
    angles = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    corners = (100 + 50 * np.column_stack([np.cos(angles), np.sin(angles)])).tolist()
    lens = LENS | {"mask": [corners] * 64}
    return wild(rng, 20, 5, camera=lens)


def touching(rng: np.random.Generator, points: int = 40) -> Document:
    """The image's edge through every target point's way: polynomials that are 0, or nearly."""
    asked = problem(
        points=[[0.1, 0.1, 0.5 + k * TINY] for k in range(points)],
        obstacles=[{"type": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.0, "clearance": 0.0}] * 50,
        clearance=0.0,
        least_distance=0.0,
        occlusion=True,
    )
    roots = np.poly(rng.uniform(0, 1, 20))
    way = {"rotation": [[0.0], [0.0], [0.0], [1.0]], "translation": [list(roots)] * 3}
    return stated(asked, way)


def many_boxes(rng: np.random.Generator, count: int = 30_000) -> Document:
    """Axes and extents of long numbers."""
    box = {
        "type": "box",
        "center": [TINY, 1.0, 3.0],
        "quaternion": [TINY, 0.6, 0.0, 0.8],
        "half_extents": [TINY, 0.1, 0.1],
    }
    return wild(rng, 2, 1, obstacles=[box] * count)


def flat_meshes(rng: np.random.Generator, count: int = 40) -> Document:
    """A thousand vertices on one line of long numbers, but for the last."""
    line = [[TINY * k, k * 1.0, HUGE * k] for k in range(998)] + [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    return wild(rng, 2, 1, obstacles=[{"type": "mesh", "vertices": line}] * count)


def many_balls(rng: np.random.Generator, count: int = 40_000) -> Document:
    """Small ones, and lines of sight."""
    balls = [{"type": "sphere", "center": x, "radius": 1e-6} for x in rng.normal(size=(count, 3)).tolist()]
    return wild(rng, 2, 2, long=False, obstacles=balls, occlusion=True)


HOSTILE: MappingProxyType[str, Callable[[np.random.Generator], Document]] = MappingProxyType(
    {
        "boxes": many_boxes,
        "flat meshes": flat_meshes,
        "balls": many_balls,
        "degree 20, long numbers": lambda rng: wild(rng, 20, 50),
        "degree 20": lambda rng: wild(rng, 20, 50, long=False),
        "distorted, long numbers": distorted,
        "distorted": lambda rng: distorted(rng, long=False),
        "clouds": many_clouds,
        "planes": many_planes,
        "meshes": many_meshes,
        "masks": masks,
        "touching": touching,
        "many points": lambda rng: wild(rng, 2, 20_000, long=False),
        "many points, long numbers": lambda rng: wild(rng, 2, 5000),
    }
)
"""What → the document."""


def main() -> None:
    """Print a line for each."""
    print(f"{'plan file':<28} {'answer':<10} {'s':>6}")
    for name, make in HOSTILE.items():
        document, before = make(np.random.default_rng(0)), process_time()
        answer = verify_plan(document)
        spent = process_time() - before
        print(f"{name:<28} {answer.status:<10} {spent:6.1f}", flush=True)


if __name__ == "__main__":
    main()
