"""Plans made false on purpose: how many does the certificate, how many does the verifier accept?

Run: ``python -m benchmarks.mutations [--count 10000] [--seed 0]``. From certified plans of the published sets
violations are planted at the true least margin (`benchmarks.true_margins`), from 1e-9 (relative) on. The
other side: problems that leave a path a little more than 1e-6 (relative) must still be certified.
"""

from __future__ import annotations

import argparse
import copy
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
from benchmarks.planning.sets import SIZES, problem
from benchmarks.true_margins import Truth, true_margins

from omniservo.errors import InputError
from omniservo.planning import CameraPath, PlanningProblem, plan_path
from omniservo.planning.certificate.certify import certify
from omniservo.verification import verify_plan

SETS = ("paper", "fisheye", "perspective", "catadioptric", "occlusion", "past-90", "boxes")
PER_PLAN = 50
"""Mutations of one plan."""
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


def plans(count: int, sets: tuple[str, ...] = SETS) -> Iterator[Certified]:
    """Yield certified plans, a problem of every set in turn; none twice."""
    made, index = 0, 0
    while made < count and index < max(SIZES.values()):
        for name in sets:
            planned = plan_path(problem(name, index)) if index < SIZES[name] and made < count else None
            if planned is not None and planned.status == "certified":
                document = planned.to_dict()
                yield Certified(document, true_margins(document))
                made += 1
        index += 1


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
    if not _tighten(document["problem"], truth.name, by):
        return None
    for line in document["certificate"]["constraints"]:
        line["margin"] = min(line["margin"], 0.0)
    return with_worst(document)


def _tighten(asked: Document, name: str, by: float) -> bool:
    family, _, rest = name.partition(" ")
    if name.startswith("visibility") or name == "dead_zone":
        asked["visibility_margin"] += by
        return asked["visibility_margin"] >= 0
    if name == "least_distance":
        asked["least_distance"] += by
        return asked["least_distance"] >= 0
    if family == "workspace" and rest[2:] in ("min", "max"):
        axis, side = "xyz".index(rest[0]), rest[2:]
        asked["workspace"][side][axis] += by if side == "min" else -by
        return True
    if family not in ("clearance", "occlusion"):
        return False
    obstacle = asked["obstacles"][int(rest.split()[1])]
    own = obstacle.get("clearance")
    own = asked.get("clearance", 0.0) if own is None else own
    if family == "occlusion":
        if obstacle["type"] not in ("sphere", "capsule"):
            return False
        obstacle["radius"] += by
        by = -by
    obstacle["clearance"] = own + by
    return obstacle["clearance"] >= 0 and obstacle.get("radius", 0.0) >= 0


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


def certified_by_planner(document: Document) -> bool:
    """True where the planner's own certificate is given to the path of the document."""
    try:
        asked = PlanningProblem.from_dict(document["problem"])
        path = CameraPath(document["path"]["rotation"], document["path"]["translation"])
        return certify(asked, path)[0] == "certified"
    except InputError:
        return False


def spared(case: Certified, rng: np.random.Generator) -> tuple[str, bool, bool] | None:
    """A requirement that leaves 1.001e-6 … 1e-3 (relative): is the path certified, and the plan verified?"""
    name = str(rng.choice(sorted(case.truth)))
    document = changed(case, name, -float(10 ** rng.uniform(-5.9995, -3)))
    if document is None:
        return None
    asked = PlanningProblem.from_dict(document["problem"])
    path = CameraPath(document["path"]["rotation"], document["path"]["translation"])
    verdict, certificate = certify(asked, path)
    document["certificate"] = certificate.to_dict()
    return name.split()[0], verdict == "certified", verify_plan(document).status == "certified"


def main() -> None:
    """Print the table by kind of mutation."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    tried: Counter[str] = Counter()
    by_verifier: Counter[str] = Counter()
    by_planner: Counter[str] = Counter()
    judged: Counter[str] = Counter()
    other: dict[str, Counter[str]] = {}
    start = perf_counter()
    for case in plans(-(-asked.count // PER_PLAN)):
        for mutant in mutants(case, rng, min(PER_PLAN, asked.count - tried.total())):
            tried[mutant.kind] += 1
            by_verifier[mutant.kind] += verify_plan(mutant.document).status == "certified"
            if mutant.path:
                judged[mutant.kind] += 1
                by_planner[mutant.kind] += certified_by_planner(mutant.document)
        for _ in range(PER_PLAN // 5):
            found = spared(case, rng)
            if found is not None:
                counts = other.setdefault(found[0], Counter())
                counts.update(tried=1, certified=found[1], verified=found[2])
    print("| false plan | tried | accepted by the verifier | judged by the certificate | accepted |")
    print("|---|---|---|---|---|")
    for kind in sorted(tried):
        print(f"| {kind} | {tried[kind]} | {by_verifier[kind]} | {judged[kind]} | {by_planner[kind]} |")
    print(f"| all | {tried.total()} | {by_verifier.total()} | {judged.total()} | {by_planner.total()} |\n")
    print("| true margin 1e-6 … 1e-3 (relative) | tried | certified | verified |\n|---|---|---|---|")
    for family, c in sorted(other.items()):
        print(f"| {family} | {c['tried']} | {c['certified']} | {c['verified']} |")
    print(f"\n{perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
