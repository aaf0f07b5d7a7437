"""Every constraint of a problem judged along one path."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import inf
from typing import Any

from omniservo.verification.camera_path import CameraPath, CameraPoint, camera_points
from omniservo.verification.clearance import clearance
from omniservo.verification.constraint import Constraint
from omniservo.verification.dead_zone import dead_zone
from omniservo.verification.decision import HOLDS, Finding
from omniservo.verification.domain import domain
from omniservo.verification.fields import BEYOND_FLOATS, NotJudged, Vector
from omniservo.verification.least_distance import least_distance
from omniservo.verification.mask import masks
from omniservo.verification.mesh import Mesh
from omniservo.verification.obstacles import SEPARATED
from omniservo.verification.occlusion import occlusion
from omniservo.verification.plan_file import Problem, Separators
from omniservo.verification.rotation import rotation
from omniservo.verification.visibility import visibility
from omniservo.verification.work import WorkExceeded, spend
from omniservo.verification.workspace import workspace

MOST_WORK = 300_000_000
"""Target points times limits on each times the degree squared: more is not judged."""
_SAMPLES, _DECISION = 128, 600
_BODY = 300
"""What a line of sight past a box, capsule or mesh costs, in limits."""
MOST_SUPPORTS = 50_000_000
"""Planes times the vertices of the meshes that they are about."""


@dataclass
class Case:
    """A constraint, the margin that is claimed for it, and what was found."""

    constraint: Constraint[Any]
    margin: Fraction
    finding: Finding = HOLDS
    subject: Any = None
    point: int | None = None

    @property
    def name(self) -> str:
        """The constraint, and the point that it is lost on."""
        return self.constraint.name + ("" if self.point is None else f" (point {self.point})")

    def judge(self, judges: list[Any], subject: CameraPath | CameraPoint, point: int | None) -> None:
        """Keep the first violation, else the first doubt."""
        for judge in judges if self.finding.verdict != "violated" else ():
            spend(_DECISION)
            finding = judge(subject)
            if finding.verdict == "violated" or (finding.verdict != "holds" and self.finding is HOLDS):
                self.finding, self.subject, self.point = finding, subject, point

    def give_up(self, note: str) -> None:
        """Leave open what is not violated: no more work is taken on."""
        if self.finding.verdict != "violated":
            self.finding = Finding("undecided", None, note)

    def reason(self) -> str:
        """Name constraint, point, w and amount in one line."""
        if self.finding.note:
            return f"{self.constraint.name}: {self.finding.note}"
        if self.finding.w is None or self.finding.verdict == "undecided":
            return f"{self.name}: a margin of {float(self.margin):.9g} is neither proven nor refuted"
        unit, candidates = self.constraint.unit, [Fraction(k, _SAMPLES) for k in range(_SAMPLES + 1)]
        needed = f"{max(0.0, float(self.margin)):.9g} {unit} needed"
        left, w = inf, self.finding.w
        try:
            left, w = min((self.constraint.left(self.subject, w), w) for w in (self.finding.w, *candidates))
        except (WorkExceeded, *BEYOND_FLOATS):
            pass
        if left >= max(0.0, float(self.margin)):  # floating point does not see what was violated
            return f"{self.name}: violated at w = {float(self.finding.w):.6g}, {needed}"
        return f"{self.name}: {left:.9g} {unit} left at w = {float(w):.6g}, {needed}"


def judged(
    problem: Problem,
    path: CameraPath,
    polygon: tuple[Vector, ...] | None,
    separators: Separators,
    margins: Mapping[str, Fraction],
) -> list[Case]:
    """Derive every constraint from the problem and judge it for the margin claimed, 0 where none is.

    Raises:
        NotJudged: more points and limits than are judged.
        WorkExceeded: more work than is taken on, and no violation found before.
    """
    families = [lambda p: clearance(p, separators), workspace, rotation]
    on_path = [_prepared(c, margins) for family in families for c in family(problem)]

    def hidden(p: Problem) -> list[Constraint[CameraPoint]]:
        return occlusion(p, separators)

    on_points = [
        _prepared(c, margins)
        for family in (domain, lambda p: visibility(p, polygon), masks, dead_zone, least_distance, hidden)
        for c in family(problem)
    ]
    work = len(problem.points) * _effort(problem, path, len(on_points) + len(polygon or ()))
    if work > MOST_WORK:
        raise NotJudged(f"{len(problem.points)} points under {len(on_points)} limits: more than is judged")
    if _support_work(problem, separators) > MOST_SUPPORTS:
        raise NotJudged("certificate.separators: more planes times vertices than are judged")
    cases = [case for case, _ in on_path + on_points]
    try:
        for case, judges in on_path:
            case.judge(judges, path, None)
        for j, point in enumerate(camera_points(path, problem.points)):
            for case, judges in on_points:
                case.judge(judges, point, j)
    except WorkExceeded as fault:
        if all(case.finding.verdict != "violated" for case in cases):
            raise
        for case in cases:
            case.give_up(str(fault))
    return cases


def _effort(problem: Problem, path: CameraPath, limits: int) -> int:
    """Return how much one point costs: degrees squared; a distorted dead zone has ten times the degree."""
    degree = 4 * (len(path.rotation[0]) - 1) + 2 * (len(path.translation[0]) - 1)
    slow = 3000 if problem.camera.dead_zone is not None and any(problem.camera.distortion) else 0
    slow += sum(map(len, problem.camera.mask))
    if problem.occlusion:
        slow += _BODY * sum(isinstance(o, SEPARATED) for o in problem.obstacles)
    return (limits + slow) * max(1, degree**2)


def _support_work(problem: Problem, separators: Separators) -> int:
    planes: dict[str, int] = {}
    for (name, _), pieces in separators.items():
        index = name.rpartition(" ")[2]
        planes[index] = planes.get(index, 0) + len(pieces)
    meshes = ((str(i), o) for i, o in enumerate(problem.obstacles) if isinstance(o, Mesh))
    return sum(planes.get(index, 0) * len(mesh.vertices) for index, mesh in meshes)


def _prepared(constraint: Constraint[Any], margins: Mapping[str, Fraction]) -> tuple[Case, list[Any]]:
    """A negative margin may be true, but the constraint itself must hold all the same."""
    margin = margins.get(constraint.name, Fraction(0))
    return Case(constraint, margin), [constraint.judge(m) for m in sorted({margin, max(margin, Fraction(0))})]
