"""A plan file judged as it stands, in exact arithmetic, believing nothing that the planner says."""

import re
from collections.abc import Sequence
from typing import Any

from omniservo.verification.camera_path import camera_path
from omniservo.verification.certificate import Certificate, Judgement, Status
from omniservo.verification.faults_of_form import IDENTITY, ORIGIN, faults_of_form
from omniservo.verification.faults_of_separators import faults_of_separators
from omniservo.verification.fields import Malformed, NotJudged, Vector
from omniservo.verification.judged import Case, judged
from omniservo.verification.plan_file import PlanFile, Stated, read_plan

_MOST_REASONS = 50
_ABOUT_A_POINT = re.compile(r"(.*) \(point (\d{1,9})\)")


def verify_plan(plan: Any) -> Certificate:
    """Judge a plan: a mapping, the path of its file, or an object whose ``to_dict()`` gives that mapping.

    Raises:
        PlanFileError: not a plan, or the file cannot be read.
    """
    try:
        file = read_plan(plan)
        return _infeasible(file) if file.status == "infeasible" else _judged_path(file)
    except Malformed as fault:
        return Certificate("refuted", (), (str(fault),))
    except NotJudged as fault:
        return Certificate("undecided", (), (str(fault),))


def _judged_path(file: PlanFile) -> Certificate:
    problem = file.problem
    if any(problem.camera.distortion) and file.stated is not None and file.polygon is None:
        raise Malformed(
            "certificate.polygon: missing; without it the view of a distorted camera is not proven"
        )
    path = camera_path(file.rotation or (), file.translation or (), problem)
    false = faults_of_form(path, problem)
    if len(false) and file.stated is None:
        return Certificate("refuted", (), tuple(false))
    stated = {} if file.stated is None else _by_constraint(file.stated)
    margins = {name: line.margin for name, line in stated.items()}
    cases = judged(problem, path, file.polygon, file.separators, margins)
    if file.stated is not None:
        false += _faults_of_list(file.stated, cases, len(problem.points))
        false += faults_of_separators(file)
    false += _reasons(cases, "violated")
    doubtful = _reasons(cases, "undecided")
    if any(problem.camera.distortion) and file.polygon is None:
        doubtful.append("visibility: a distorted camera's view is proven through certificate.polygon only")
    if file.status == "refuted" and not false and not doubtful:
        false.append('stated "refuted", but the path satisfies every constraint')
    status: Status = "refuted" if false else "undecided" if doubtful else "certified"
    return Certificate(status, tuple(map(_judgement, cases)), (*false, *doubtful))


def _by_constraint(stated: Sequence[Stated]) -> dict[str, Stated]:
    lines: dict[str, Stated] = {}
    for line in stated:
        if lines.setdefault(_without_point(line.name)[0], line) is not line:
            raise Malformed(f"certificate: {line.name!r:.80} stands twice")
    return lines


def _without_point(name: str) -> tuple[str, int | None]:
    match = _ABOUT_A_POINT.fullmatch(name)
    return (match[1], int(match[2])) if match else (name, None)


def _faults_of_list(stated: Sequence[Stated], cases: Sequence[Case], points: int) -> list[str]:
    """Every constraint of the problem must be in the certificate, in its unit, and nothing else."""
    units = {case.constraint.name: case.constraint.unit for case in cases}
    faults = []
    for line in stated:
        name, point = _without_point(line.name)
        if name not in units or (point is not None and point >= points):
            faults.append(f"certificate: {line.name!r:.80} is no constraint of this problem")
        elif line.unit != units[name]:
            faults.append(
                f"certificate: {line.name!r:.80} is stated in {line.unit!r:.20}, not in {units[name]}"
            )
    present = {_without_point(line.name)[0] for line in stated}
    return faults + [f"certificate: {name} is missing" for name in units if name not in present]


def _reasons(cases: Sequence[Case], verdict: str) -> list[str]:
    """One line for each of the first cases; an untrusted file may hold very many."""
    lost = [case for case in cases if case.finding.verdict == verdict]
    more = (
        [f"{len(lost) - _MOST_REASONS} more constraints are {verdict}"] if len(lost) > _MOST_REASONS else []
    )
    return [case.reason() for case in lost[:_MOST_REASONS]] + more


def _judgement(case: Case) -> Judgement:
    w = None if case.finding.w is None else float(case.finding.w)
    return Judgement(case.name, float(case.margin), case.constraint.unit, case.finding.verdict, w)


def _infeasible(file: PlanFile) -> Certificate:
    """There is no path where an end pose violates a constraint; a pose is judged as a path of degree 0."""
    problem, doubtful = file.problem, any(file.problem.camera.distortion)
    for name, translation, quaternion in (
        ("start", ORIGIN, IDENTITY),
        ("goal", problem.goal_translation, problem.goal_quaternion),
    ):
        pose = camera_path(_constant(quaternion), _constant(translation), problem)
        cases = judged(problem, pose, None, {}, {})
        for case in cases:
            if case.finding.verdict == "violated":
                reason = f"infeasible confirmed at the {name}: {case.reason()}"
                return Certificate("refuted", tuple(map(_judgement, cases)), (reason,))
            doubtful |= case.finding.verdict == "undecided"
    if doubtful:
        return Certificate("undecided", (), ("stated infeasible, which is neither proven nor refuted",))
    reason = "stated infeasible, but both end poses satisfy every constraint"
    return Certificate("refuted", (), (reason,))


def _constant(vector: Vector) -> tuple[Vector, ...]:
    return tuple((x,) for x in vector)
