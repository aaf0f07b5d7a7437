"""Problems for the mutations beyond the published sets: these, with other obstacles and cameras.

A ball of radius r with clearance c is replaced by a body inside the ball of radius r + c/2, with clearance
c/2, so that the end poses stay free; by turns of a set without and a set with lines of sight.
"""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Any

import numpy as np
from benchmarks.comparisons.planning.draws import Draws
from benchmarks.comparisons.planning.sets import SIZES, problem
from benchmarks.verifier_speed import DISTORTION

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import PlanningProblem

CLOUD_POINTS = 40
Fields = dict[str, Any]


def scene(name: str, index: int) -> PlanningProblem:
    """Return problem ``index`` of a published set or of a family of `FAMILIES`.

    Raises:
        InputError: what was drawn is no legal problem.
    """
    if name in SIZES:
        return problem(name, index)
    return PlanningProblem.from_dict(FAMILIES[name](Draws(name, index), index))


def size(name: str) -> int:
    """Return the number of problems."""
    return SIZES.get(name, 500)


def _base(index: int, sets: tuple[str, ...] = ("fisheye", "occlusion")) -> Fields:
    return problem(sets[index % len(sets)], index).to_dict()


def _ball(o: Fields, asked: Fields) -> tuple[FloatArray, float, Fields]:
    """Return the middle and the radius that a body may fill, and its clearance."""
    own = o.get("clearance")
    own = asked["clearance"] if own is None else own
    return np.array(o["center"]), o["radius"] + own / 2, {"clearance": own / 2}


def _mesh(draws: Draws, o: Fields, asked: Fields) -> Fields:
    center, radius, fields = _ball(o, asked)
    around = np.array([draws.direction() for _ in range(draws.whole(6, 10))])
    return {"type": "mesh", "vertices": (center + radius * around).tolist(), **fields}


def _cloud(draws: Draws, o: Fields, asked: Fields) -> Fields:
    center, radius, fields = _ball(o, asked)
    around = np.array([draws.direction() for _ in range(CLOUD_POINTS)])
    points = (center + 0.8 * radius * around).tolist()
    return {"type": "cloud", "points": points, "radius": 0.2 * radius, **fields}


def _capsule(draws: Draws, o: Fields, asked: Fields) -> Fields:
    center, radius, fields = _ball(o, asked)
    half = 0.5 * radius * draws.direction()
    ends = {"from": (center - half).tolist(), "to": (center + half).tolist()}
    return {"type": "capsule", **ends, "radius": 0.5 * radius, **fields}


def _box(draws: Draws, o: Fields, asked: Fields) -> Fields:
    center, radius, fields = _ball(o, asked)
    extents = draws.numbers(0.3, 0.57, 3) * radius
    turn = {"quaternion": draws.turn(180.0).as_quat().tolist(), "half_extents": extents.tolist()}
    return {"type": "box", "center": center.tolist(), **turn, **fields}


def _sphere(draws: Draws, o: Fields, asked: Fields) -> Fields:
    center, radius, fields = _ball(o, asked)
    return {"type": "sphere", "center": center.tolist(), "radius": radius, **fields}


BODIES = (_mesh, _cloud, _capsule, _box, _sphere)


def _replaced(body: Callable[[Draws, Fields, Fields], Fields]) -> Callable[[Draws, int], Fields]:
    def make(draws: Draws, index: int) -> Fields:
        asked = _base(index)
        return asked | {"obstacles": [body(draws, o, asked) for o in asked["obstacles"]]}

    return make


def _moving(draws: Draws, index: int) -> Fields:
    """Any body, moved by up to 50 mm a coefficient, degree 1 to 3; at rest at w = 0."""
    asked, obstacles = _base(index), []
    for k, o in enumerate(asked["obstacles"]):
        body = BODIES[(index // 2 + k) % len(BODIES)](draws, o, asked)
        rows = draws.numbers(-0.05, 0.05, 3, draws.whole(1, 3))
        obstacles.append(body | {"motion": [[*row, 0.0] for row in rows.tolist()]})
    return asked | {"obstacles": obstacles}


def _plane(draws: Draws, asked: Fields, least: float) -> Fields:
    """Return a half-space behind both end poses, by 2 to 40 mm more than ``least``."""
    normal, goal = draws.direction(), np.array(asked["goal"]["translation"])
    offset = min(0.0, float(normal @ goal)) - least - draws.number(0.002, 0.04)
    return {"normal": normal.tolist(), "offset": offset}


def _half_spaces(draws: Draws, index: int) -> Fields:
    """Two walls in place of what the set has; one of them may come nearer and withdraw."""
    asked = _base(index)
    walls = [{"type": "half_space", **_plane(draws, asked, 0.02), "clearance": 0.02} for _ in range(2)]
    if index % 3 == 0:
        away = draws.number(0.0, 0.01) * draws.direction()
        walls[0]["motion"] = [[x, -x, 0.0] for x in away.tolist()]
    return asked | {"obstacles": asked["obstacles"][: index % 4] + walls}


def _workspace(draws: Draws, index: int) -> Fields:
    asked = _base(index)
    return asked | {"workspace": {"half_spaces": [_plane(draws, asked, 0.0) for _ in range(3)]}}


def _masks(draws: Draws, index: int) -> Fields:
    """Three quadrilaterals of the image that no target point stands in at the ends."""
    asked = _base(index, ("fisheye", "perspective", "catadioptric"))
    lens = asked["camera"]
    seen = _pixels_at_ends(PlanningProblem.from_dict(asked))
    polygons: list[list[list[float]]] = []
    for _ in range(100):
        middle = seen.min(axis=0) + draws.numbers(0.0, 1.0, 2) * np.ptp(seen, axis=0)
        reach = draws.number(8.0, 30.0)
        angles = 2 * np.pi * (np.arange(4) + draws.numbers(0.0, 0.7, 4)) / 4
        corners = middle + reach * np.column_stack([np.cos(angles), np.sin(angles)])
        if len(polygons) < 3 and np.linalg.norm(seen - middle, axis=1).min() > reach + 3.0:
            polygons.append(corners.tolist())
    return asked | {"camera": lens | {"mask": polygons}}


def _pixels_at_ends(asked: PlanningProblem) -> FloatArray:
    goal = asked.initial_T_goal.inv().apply(asked.points)
    return np.asarray(asked.camera.project(np.concatenate([asked.points, goal]))[0])


def _distorted(draws: Draws, index: int) -> Fields:
    """Half to all of a fixed distortion; every other one with a dead zone where no point starts or ends."""
    asked = _base(index, ("perspective",))
    bent = [draws.number(0.5, 1.0) * k for k in DISTORTION]
    lens = asked["camera"] | {"distortion": bent, "max_angle": None}
    if index % 4 == 0:
        seen = _pixels_at_ends(PlanningProblem.from_dict(asked | {"camera": lens}))
        middle = seen.mean(axis=0)
        radius = 0.8 * float(np.linalg.norm(seen - middle, axis=1).min()) - 2.0
        if radius > 1.0:
            lens |= {"dead_zone": {"center": middle.tolist(), "radius": radius}}
    return asked | {"camera": lens}


FAMILIES = MappingProxyType(
    {
        "meshes": _replaced(_mesh),
        "clouds": _replaced(_cloud),
        "capsules": _replaced(_capsule),
        "boxes seen past": _replaced(_box),
        "moving": _moving,
        "half-spaces": _half_spaces,
        "workspace": _workspace,
        "masks": _masks,
        "distorted": _distorted,
    }
)
"""Name → the fields of problem ``index``."""
