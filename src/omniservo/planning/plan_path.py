"""From a problem to a plan."""

from __future__ import annotations

import time
from typing import Literal

from omniservo.errors import InputError
from omniservo.geometry.arrays import finite_number
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certify import certify
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.paper_search import paper_path
from omniservo.planning.plan import Plan, Status
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_search import STARTS, ProblemSearch

Method = Literal["certified", "paper"]


def plan_path(problem: PlanningProblem, *, method: Method = "certified", seed: int = 0) -> Plan:
    """Return a plan; the same problem, method and seed give the same path.

    Args:
        problem: what to plan.
        method: "certified": a path that is proven for all w, of least bending energy among those near the
            first that is found. "paper": (36)–(38) on samples, judged by the same certificate.
        seed: turns the directions in which detours are tried.

    Raises:
        InputError: no such method, one that cannot take an obstacle, or the visibility margin leaves nothing
            of the image.
    """
    if method not in ("certified", "paper"):
        raise InputError(f"method: {method!r} given; legal: 'certified', 'paper'")
    finite_number("seed", seed, minimum=0)
    begin = time.perf_counter()
    reason = violation_at_end(problem)
    if reason:
        return Plan(problem, "infeasible", None, None, time.perf_counter() - begin, method, reason)
    found, note = paper_path(problem) if method == "paper" else (_certified_path(problem, int(seed)), "")
    verdict, certificate = certify(problem, found)
    status: Status = verdict
    if verdict != "certified":
        worst = certificate.worst
        where = f"{worst.name}: {worst.margin:.6g} {worst.unit} left at w = {worst.w:.4f}"
        if method == "certified" and not (verdict == "undecided" and problem.camera.is_distorted):
            status = "not_found"
            note = f"no path was found in {STARTS} starts; the best attempt fails {where}"
        else:
            note = f"{note}{'; ' if note else ''}{verdict}: {where}"
    return Plan(problem, status, found, certificate, time.perf_counter() - begin, method, note)


def _certified_path(problem: PlanningProblem, seed: int) -> CameraPath:
    search = ProblemSearch.of(problem, seed)
    return search.run(0, search.starts, 1).path
