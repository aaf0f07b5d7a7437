"""Plans made false on purpose: how many does the certificate, how many does the verifier accept?

Run: ``python -m benchmarks.mutations [--count 10000] [--seed 0]``. From certified plans of the published sets
and of the families of `benchmarks.mutation_scenes` violations are planted at the true least margin
(`benchmarks.true_margins`), from 1e-9 (relative) on. The other side: problems that leave a path a little more
than 1e-6 (relative) must still be certified.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from time import perf_counter

import numpy as np
from benchmarks.mutation_kinds import Certified, Document, changed, closer, mutants
from benchmarks.mutation_scenes import FAMILIES, scene, size
from benchmarks.true_margins import true_margins

from omniservo.errors import InputError
from omniservo.planning import CameraPath, PlanningProblem, plan_path
from omniservo.planning.certificate.certify import certify
from omniservo.verification import verify_plan

SETS = ("paper", "fisheye", "perspective", "catadioptric", "occlusion", "past-90", "boxes")
EVERYTHING = (*SETS, *FAMILIES)
PER_PLAN = 50
"""Mutations of one plan."""


def plans(count: int, sets: tuple[str, ...] = EVERYTHING) -> Iterator[tuple[str, Certified]]:
    """Yield set and certified plan, a problem of every set in turn; none twice."""
    made, index = 0, 0
    while made < count and index < max(map(size, sets)):
        for name in sets:
            document = _planned(name, index) if index < size(name) and made < count else None
            if document is not None:
                yield name, Certified(document, true_margins(document))
                made += 1
        index += 1


def _planned(name: str, index: int) -> Document | None:
    try:
        planned = plan_path(scene(name, index))
    except InputError:
        return None  # what was drawn is no legal problem: an end pose behind a wall, for instance
    return planned.to_dict() if planned.status == "certified" else None


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
    if case.truth[name].unit == "px" and "visibility polygon" in case.truth:
        return None  # the polygon lies inside the image: what is left to its edges is more than it proves
    relative = -float(10 ** rng.uniform(-5.9995, -3))
    document = changed(case, name, relative * max(1.0, _size(case, name) / float(case.truth[name].needed)))
    if document is None:
        return None
    if name.startswith("occlusion"):
        room = case.truth[name.replace("occlusion", "clearance")].margin
        if closer(case, document, name) > room - 1e-5:
            return None
    asked = PlanningProblem.from_dict(document["problem"])
    path = CameraPath(document["path"]["rotation"], document["path"]["translation"])
    verdict, certificate = certify(asked, path)
    document["certificate"] = certificate.to_dict()
    return name.split()[0], verdict == "certified", verify_plan(document).status == "certified"


def _size(case: Certified, name: str) -> float:
    """Return the size of a solid that is seen past [m]: of a sphere the radius counts already."""
    if not name.startswith("occlusion"):
        return 0.0
    solid = case.document["problem"]["obstacles"][int(name.split()[2])]
    if solid["type"] == "mesh":
        return float(0.5 * np.linalg.norm(np.ptp(solid["vertices"], axis=0)))
    return float(np.linalg.norm(solid.get("half_extents", 0.0)))


@dataclass
class Counts:
    """What was answered, by kind of mutation or by set."""

    tried: Counter[str] = field(default_factory=Counter)
    by_verifier: Counter[str] = field(default_factory=Counter)
    judged: Counter[str] = field(default_factory=Counter)
    by_planner: Counter[str] = field(default_factory=Counter)

    def add(self, name: str, verified: bool, certified: bool | None) -> None:
        """Count one answer; None where the certificate has nothing to judge."""
        self.tried[name] += 1
        self.by_verifier[name] += verified
        self.judged[name] += certified is not None
        self.by_planner[name] += bool(certified)

    def print(self, title: str) -> None:
        """Print a table and its sum."""
        print(f"| {title} | tried | accepted by the verifier | judged by the certificate | accepted |")
        print("|---|---|---|---|---|")
        rows = [(name, *(c[name] for c in self._columns())) for name in sorted(self.tried)]
        for row in (*rows, ("all", *(c.total() for c in self._columns()))):
            print("| " + " | ".join(map(str, row)) + " |")
        print(flush=True)

    def _columns(self) -> tuple[Counter[str], ...]:
        return self.tried, self.by_verifier, self.judged, self.by_planner


def main() -> None:
    """Print the tables: by kind of mutation, by set, and the other side."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--sets", nargs="+", choices=EVERYTHING, default=EVERYTHING)
    asked = parser.parse_args()
    rng = np.random.default_rng(asked.seed)
    kinds, by_set = Counts(), Counts()
    other: dict[str, Counter[str]] = {}
    start = perf_counter()
    for name, case in plans(-(-asked.count // PER_PLAN), tuple(asked.sets)):
        for mutant in mutants(case, rng, min(PER_PLAN, asked.count - kinds.tried.total())):
            verified = verify_plan(mutant.document).status == "certified"
            certified = certified_by_planner(mutant.document) if mutant.path else None
            kinds.add(mutant.kind, verified, certified)
            by_set.add(name, verified, certified)
            if verified or certified:
                print(f"accepted: {name}, {mutant.kind}, {case.document['problem']}", flush=True)
        for _ in range(PER_PLAN // 5):
            found = spared(case, rng)
            if found is not None:
                counts = other.setdefault(found[0], Counter())
                counts.update(tried=1, certified=int(found[1]), verified=int(found[2]))
                if not all(found[1:]):
                    print(f"not certified: {name}, {found}", flush=True)
    kinds.print("false plan")
    by_set.print("set")
    print("| true margin 1e-6 … 1e-3 (relative) | tried | certified | verified |\n|---|---|---|---|")
    for family, c in sorted(other.items()):
        print(f"| {family} | {c['tried']} | {c['certified']} | {c['verified']} |")
    print(f"\n{perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
