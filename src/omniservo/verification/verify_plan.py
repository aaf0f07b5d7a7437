"""A plan file judged as it stands, in exact arithmetic, believing nothing that the planner says."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from omniservo.verification.camera_path import camera_path
from omniservo.verification.certificate import Certificate, Judgement, Status
from omniservo.verification.faults_of_form import IDENTITY, ORIGIN, faults_of_form
from omniservo.verification.faults_of_list import by_constraint, faults_of_list
from omniservo.verification.faults_of_separators import faults_of_separators
from omniservo.verification.fields import Malformed, NotJudged, Vector
from omniservo.verification.judged import Case, judged
from omniservo.verification.plan_file import PlanFile, Problem, plan_document, read_plan, read_problem
from omniservo.verification.problem_differences import Difference, problem_differences
from omniservo.verification.work import WorkExceeded, bounded

_MOST_REASONS = 50


def verify_plan(plan: Any, *, problem: Any = None) -> Certificate:
    """Judge a plan: a mapping, the path of its file, or an object whose ``to_dict()`` gives that mapping.

    Args:
        plan: what is judged, for the problem that stands in it.
        problem: the problem that was meant, in the same three ways, its camera embedded. A plan whose own
            problem says anything else is refuted, and ``differences`` names the fields with both values.

    Raises:
        PlanFileError: not a plan or problem, or the file cannot be read.
    """
    meant = None if problem is None else read_problem(problem)
    found, differences = _judged(plan, meant)
    if not differences:
        return replace(found, differences=differences)
    lines = [str(difference) for difference in differences[:_MOST_REASONS]]
    if len(differences) > _MOST_REASONS:
        lines.append(f"problem: {len(differences) - _MOST_REASONS} more fields differ")
    return Certificate("refuted", found.constraints, (*lines, *found.reasons), differences)


def _judged(plan: Any, meant: Mapping[str, Any] | None) -> tuple[Certificate, tuple[Difference, ...] | None]:
    """Return what is found of the plan, and where its problem differs from the one that was meant."""
    differences = None
    try:
        with bounded():
            document = plan_document(plan)
            file = read_plan(document)
            if meant is not None:
                differences = problem_differences(document["problem"], meant)
            found = _infeasible(file) if file.status == "infeasible" else _judged_path(file)
            return found, differences
    except Malformed as fault:
        return Certificate("refuted", (), (str(fault),)), differences
    except (NotJudged, WorkExceeded) as fault:
        return Certificate("undecided", (), (str(fault),)), differences


def _judged_path(file: PlanFile) -> Certificate:
    problem = file.problem
    if any(problem.camera.distortion) and file.stated is not None and file.polygon is None:
        raise Malformed(
            "certificate.polygon: missing; without it the view of a distorted camera is not proven"
        )
    path = camera_path(file.rotation or (), file.translation or (), problem.points)
    false = faults_of_form(path, problem)
    if len(false) and file.stated is None:
        return Certificate("refuted", (), tuple(false))
    stated = {} if file.stated is None else by_constraint(file.stated)
    margins = {name: line.margin for name, line in stated.items()}
    cases = judged(problem, path, file.polygon, file.separators, margins)
    if file.stated is not None:
        false += faults_of_list(file.stated, file.worst, cases, len(problem.points))
        false += faults_of_separators(file)
    false += _reasons(cases, "violated")
    doubtful = _reasons(cases, "undecided")
    if any(problem.camera.distortion) and file.polygon is None:
        doubtful.append("visibility: a distorted camera's view is proven through certificate.polygon only")
    if file.status == "refuted" and not false and not doubtful:
        false.append('stated "refuted", but the path satisfies every constraint')
    status: Status = "refuted" if false else "undecided" if doubtful else "certified"
    return Certificate(status, tuple(map(_judgement, cases)), (*false, *doubtful))


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
    for name, w, translation, quaternion in (
        ("start", 0, ORIGIN, IDENTITY),
        ("goal", 1, problem.goal_translation, problem.goal_quaternion),
    ):
        pose = camera_path(_constant(quaternion), _constant(translation), problem.points)
        cases = judged(_stopped(problem, w), pose, None, {}, {})
        for case in cases:
            if case.finding.verdict == "violated":
                reason = f"infeasible confirmed at the {name}: {case.reason()}"
                return Certificate("refuted", tuple(map(_judgement, cases)), (reason,))
            doubtful |= case.finding.verdict == "undecided"
    if doubtful:
        return Certificate("undecided", (), ("stated infeasible, which is neither proven nor refuted",))
    reason = "stated infeasible, but both end poses satisfy every constraint"
    return Certificate("refuted", (), (reason,))


def _stopped(problem: Problem, w: int) -> Problem:
    """Return the problem with moving obstacles where they are at w = 0 or 1."""
    obstacles = []
    for o in problem.obstacles:
        at = tuple(sum(row, start=row[0] * 0) if w else row[-1] for row in o.motion or ())
        obstacles.append(o if o.motion is None else replace(o, motion=_constant(at)))
    return replace(problem, obstacles=tuple(obstacles))


def _constant(vector: Vector) -> tuple[Vector, ...]:
    return tuple((x,) for x in vector)
