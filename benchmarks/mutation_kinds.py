"""Ways to make a certified plan false, between samples and by as little as 1e-9 (relative)."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from benchmarks.true_margins import Truth
from benchmarks.true_pixels import pixel
from benchmarks.true_views import horner, view

RELATIVE = (1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
Document = dict[str, Any]


@dataclass(frozen=True)
class Certified:
    """A certified plan and the truth about it."""

    document: Document
    truth: dict[str, Truth]


@dataclass(frozen=True)
class Mutant:
    """A plan file that is false; with ``path`` the path itself is wrong for the problem."""

    kind: str
    document: Document
    path: bool


Mutation = Callable[[Certified, np.random.Generator], Mutant | None]


def tightened(case: Certified, rng: np.random.Generator, relative: float) -> Mutant | None:
    """One requirement grows until the true least margin is −relative times what is asked for."""
    name = str(rng.choice(sorted(case.truth)))
    document = changed(case, name, relative)
    return document and Mutant(f"violation planted, {relative:.0e}", document, path=True)


def changed(case: Certified, name: str, relative: float) -> Document | None:
    """Return the plan with one requirement moved past (below 0: up to) its true least margin."""
    truth = case.truth[name]
    if name.startswith(("visibility", "dead_zone")):
        pixels = [t for t in case.truth.values() if t.unit == "px"]
        truth = min(pixels, key=lambda t: t.margin)
    by = float(truth.margin + relative * truth.needed)
    document = copy.deepcopy(case.document)
    if not _tighten(document["problem"], truth, by):
        return None
    for line in document["certificate"]["constraints"]:
        line["margin"] = min(line["margin"], 0.0)
    return with_worst(document)


def _tighten(asked: Document, truth: Truth, by: float) -> bool:
    name = truth.name
    family, _, rest = name.partition(" ")
    if name.startswith("visibility") or name == "dead_zone":
        asked["visibility_margin"] += by
        return asked["visibility_margin"] >= 0
    if name == "least_distance":
        asked["least_distance"] += by
        return asked["least_distance"] >= 0
    if name.startswith("workspace half-space"):
        asked["workspace"]["half_spaces"][int(rest.split()[1])]["offset"] += by
        return True
    if family == "workspace":
        axis, side = "xyz".index(rest[0]), rest[2:]
        asked["workspace"][side][axis] += by if side == "min" else -by
        return True
    if family not in ("clearance", "occlusion"):
        return False
    obstacle = asked["obstacles"][int(rest.split()[1])]
    own = obstacle.get("clearance")
    own = asked.get("clearance", 0.0) if own is None else own
    if family == "occlusion":
        if "radius" not in obstacle:
            return _moved(obstacle, truth, by)
        obstacle["radius"] += by
        obstacle["clearance"] = max(0.0, own - by)
        return bool(obstacle["radius"] >= 0)
    obstacle["clearance"] = own + by
    return bool(obstacle["clearance"] >= 0)


def closer(case: Certified, document: Document, name: str) -> float:
    """Return by how much planting an occlusion may bring an obstacle closer to the path [m]."""
    i = int(name.split()[2])
    before, after = case.document["problem"], document["problem"]
    old, new = before["obstacles"][i], after["obstacles"][i]
    place = {"box": "center", "mesh": "vertices"}.get(old["type"])
    if place is None:
        return _reach(new, after) - _reach(old, before)
    shift = np.array(new[place]) - np.array(old[place])
    return float(np.linalg.norm(shift.reshape(-1, 3)[0]))


def _moved(solid: Document, truth: Truth, by: float) -> bool:
    """Move a box or a mesh towards the line of sight that is nearest to it."""
    shift = -by * np.array(truth.away)
    if solid["type"] == "box":
        solid["center"] = (np.array(solid["center"]) + shift).tolist()
    else:
        solid["vertices"] = (np.array(solid["vertices"]) + shift).tolist()
    return abs(float(np.linalg.norm(truth.away)) - 1.0) < 1e-6


def with_worst(document: Document) -> Document:
    """Return the document with its worst line stated truly, so that nothing but the plant is false."""
    lines = document["certificate"]["constraints"]
    unit = document["certificate"]["worst"]["unit"]
    document["certificate"]["worst"] = dict(
        min((line for line in lines if line["unit"] == unit), key=lambda line: line["margin"])
    )
    return document


def nudged(case: Certified, rng: np.random.Generator) -> Mutant:
    """One coefficient moved: the path starts or ends elsewhere."""
    document = copy.deepcopy(case.document)
    rows = document["path"][str(rng.choice(["rotation", "translation"]))]
    i, k = int(rng.integers(3)), int(rng.integers(len(rows[0])))
    size = float(np.hypot.reduce([row[-1] for row in rows])) if len(rows) == 4 else 1.0
    rows[i][k] += float(rng.choice([-1, 1]) * 10 ** rng.uniform(-8, -1)) * max(size, 1.0)
    return Mutant("path ends elsewhere", document, path=True)


def still(case: Certified, rng: np.random.Generator) -> Mutant:
    """The path stands still at one of its ends."""
    document, w = copy.deepcopy(case.document), int(rng.integers(2))
    for name in ("rotation", "translation"):
        rows = document["path"][name]
        document["path"][name] = [[0.0] * (len(row) - 1) + [sum(row) if w else row[-1]] for row in rows]
    return Mutant("path stands still", document, path=True)


def dropped(case: Certified, rng: np.random.Generator) -> Mutant:
    """A constraint is missing from the certificate."""
    document = copy.deepcopy(case.document)
    lines = document["certificate"]["constraints"]
    gone = lines.pop(int(rng.integers(len(lines))))
    if document["certificate"]["worst"]["name"] == gone["name"]:
        document["certificate"]["worst"] = None
    return Mutant("constraint dropped", document, path=False)


def overstated(case: Certified, rng: np.random.Generator) -> Mutant | None:
    """A margin is stated 1e-9 … 1e-3 (relative to itself) above the truth."""
    document = copy.deepcopy(case.document)
    lines = document["certificate"]["constraints"]
    line = lines[int(rng.integers(len(lines)))]
    truth = case.truth[line["name"].split(" (")[0]].margin
    line["margin"] = float(truth * (1 + rng.choice(RELATIVE)))
    return Mutant("margin overstated", with_worst(document), path=False) if line["margin"] > truth else None


def misnamed(case: Certified, rng: np.random.Generator) -> Mutant:
    """The worst line has more left than is true, or is another line than the worst."""
    document = copy.deepcopy(case.document)
    worst = document["certificate"]["worst"]
    others = [
        line
        for line in document["certificate"]["constraints"]
        if line["unit"] == worst["unit"] and line["margin"] > worst["margin"]
    ]
    if others and rng.random() < 0.5:
        document["certificate"]["worst"] = dict(others[int(rng.integers(len(others)))])
    else:
        worst["margin"] += abs(worst["margin"]) * 1e-9 + 1e-12
    return Mutant("worst line false", document, path=False)


def separated_wrongly(case: Certified, rng: np.random.Generator) -> Mutant | None:
    """A separating plane turned round, moved along w, or left out."""
    document = copy.deepcopy(case.document)
    separators = document["certificate"].get("separators", [])
    if not separators:
        return None
    at = int(rng.integers(len(separators)))
    pieces = separators[at]["pieces"]
    k, how = int(rng.integers(len(pieces))), int(rng.integers(4))
    if how == 0:
        pieces[k][2:] = [-x for x in pieces[k][2:]]
    elif how == 1:
        pieces[k][0 if k else 1] += 1e-9 if k else -1e-9
    elif how == 2:
        pieces.pop(k)
    else:
        separators.pop(at)
    return Mutant("separators shifted", document, path=False)


def edited(case: Certified, rng: np.random.Generator) -> Mutant:
    """The problem is changed after the fact."""
    document = copy.deepcopy(case.document)
    asked, path = document["problem"], document["path"]
    w = float(rng.uniform(0.05, 0.95))
    on_path = [float(np.polyval(row, w)) for row in path["translation"]]
    how = int(rng.integers(5))
    if how == 0:
        asked["goal"]["translation"][int(rng.integers(3))] += float(10 ** rng.uniform(-8, -2))
    elif how == 1:
        asked["obstacles"].append({"type": "sphere", "center": on_path, "radius": 1e-6, "clearance": 0.0})
        _add_line(document, f"clearance obstacle {len(asked['obstacles']) - 1}", "m")
    elif how == 2:
        axis, side = int(rng.integers(3)), float(10 ** rng.uniform(-9, -3))
        low, high = [-9.0] * 3, [9.0] * 3
        t = np.polyval(path["translation"][axis], np.linspace(0, 1, 1001))
        low[axis] = float(t.min() + side * np.abs(t).max())
        asked["workspace"] = {"min": low, "max": high}
        for name in (f"workspace {x} {end}" for x in "xyz" for end in ("min", "max")):
            _add_line(document, name, "m")
    elif how == 3:
        asked["degrees"]["translation"] = len(path["translation"][0]) - 2
    else:
        asked["points"].append(on_path)
    return Mutant("problem edited after the fact", document, path=how != 0)


def intruded(case: Certified, rng: np.random.Generator) -> Mutant | None:
    """A vertex, a point of a cloud or a motion brings an obstacle too near to the path at a random w."""
    document = copy.deepcopy(case.document)
    asked, path = document["problem"], document["path"]
    obstacles = [o for o in asked["obstacles"] if _reach(o, asked) > 0]
    if not obstacles:
        return None
    o, w = obstacles[int(rng.integers(len(obstacles)))], float(rng.uniform(0.05, 0.95))
    at = np.array([horner(row, w) for row in path["translation"]])
    at -= [horner(row, w) for row in o.get("motion") or ((0.0,),) * 3]
    aside = rng.normal(size=3)
    aside *= _reach(o, asked) * (1 - float(rng.choice(RELATIVE))) / np.linalg.norm(aside)
    if o["type"] == "mesh":
        o["vertices"].append((at + aside).tolist())
    elif o["type"] == "cloud":
        o["points"].append((at + aside).tolist())
    elif o["type"] in ("sphere", "capsule"):
        shift = (at + aside - np.array(o["center" if o["type"] == "sphere" else "from"])) / (4 * w * (1 - w))
        o["motion"] = _with_bump(o.get("motion") or [[0.0]] * 3, shift)
    else:
        return None
    for line in document["certificate"]["constraints"]:
        line["margin"] = min(line["margin"], 0.0)
    return Mutant("obstacle on the path", with_worst(document), path=True)


def _reach(o: Document, asked: Document) -> float:
    own = o.get("clearance")
    return float(o.get("radius", 0.0) + (asked.get("clearance", 0.0) if own is None else own))


def _with_bump(motion: list[list[float]], shift: np.ndarray) -> list[list[float]]:
    """Return the motion plus 4w(1 − w)·shift."""
    rows = [[0.0] * max(0, 3 - len(row)) + list(row) for row in motion]
    for row, by in zip(rows, shift.tolist(), strict=True):
        row[-3] -= 4 * by
        row[-2] += 4 * by
    return rows


def masked(case: Certified, rng: np.random.Generator) -> Mutant | None:
    """A mask of a pixel or less appears where a target point is at a random w."""
    document = copy.deepcopy(case.document)
    asked, lens = document["problem"], document["problem"]["camera"]
    if any(lens.get("distortion") or ()):
        return None
    w, h = float(rng.uniform(0.05, 0.95)), asked["points"][int(rng.integers(len(asked["points"])))]
    at = pixel(view(document["path"], h, w, math), lens)
    around = float(10 ** rng.uniform(-5, 0)) * np.array([[1.0, 0.0], [-0.5, 0.8], [-0.5, -0.8]])
    lens["mask"] = [*(lens.get("mask") or ()), (np.array(at) + around).tolist()]
    _add_line(document, f"visibility mask {len(lens['mask']) - 1}", "px")
    return Mutant("mask on a target point's way", document, path=True)


def _add_line(document: Document, name: str, unit: str) -> None:
    document["certificate"]["constraints"].append({"name": name, "margin": 0.0, "unit": unit, "w": 0.5})
    with_worst(document)


MUTATIONS: tuple[Mutation, ...] = (
    *(partial(tightened, relative=relative) for relative in RELATIVE),
    nudged,
    still,
    dropped,
    overstated,
    overstated,
    misnamed,
    separated_wrongly,
    edited,
    edited,
    intruded,
    masked,
)


def mutants(case: Certified, rng: np.random.Generator, count: int) -> Iterator[Mutant]:
    """Yield false plans of every kind in turn."""
    made = k = 0
    while made < count:
        mutant = MUTATIONS[k % len(MUTATIONS)](case, rng)
        k += 1
        if mutant is not None:
            made += 1
            yield mutant
