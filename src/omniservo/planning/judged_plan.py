"""From a path to a plan that says what it is worth."""

from __future__ import annotations

import time

from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certificate.certify import certified_but_for
from omniservo.planning.end_poses import just_met_at
from omniservo.planning.plan import Plan, Status
from omniservo.planning.planning_problem import PlanningProblem


def judged_plan(
    problem: PlanningProblem, path: CameraPath, begin: float, method: str, note: str, looked: str = ""
) -> Plan:
    """Return the plan of a path, with its certificate.

    Args:
        problem: what was planned.
        path: what was found, or the best attempt.
        begin: `time.perf_counter` when planning began [s].
        method: "certified" or "paper".
        note: what to know of it; "" if nothing.
        looked: how far was looked for a path: a path that is not certified is the best attempt, and the plan
            not found. "": it is judged as it is.
    """
    verdict, certificate, missing = certified_but_for(problem, path)
    status: Status = verdict
    if missing is not None:  # the certificate's worst may be one that is proven and just met
        left = "no pixel" if missing.is_unseen else f"{missing.margin:.6g} {missing.unit} left"
        where = f"{missing.name}: {left} at w = {missing.w:.4f}"
        pose = just_met_at(problem, missing)
        if pose:
            where += f"; the {pose} pose just meets it, and what is just met is not proven: leave it room"
        if looked and not (verdict == "undecided" and problem.camera.is_distorted):
            status = "not_found"
            note = f"{looked}; the best attempt fails {where}"
        else:
            note = f"{note}{'; ' if note else ''}{verdict}: {where}"
    return Plan(problem, status, path, certificate, time.perf_counter() - begin, method, note)


def infeasible_plan(problem: PlanningProblem, begin: float, method: str, reason: str) -> Plan:
    """Return the plan of a problem that has no path, for the reason given."""
    return Plan(problem, "infeasible", None, None, time.perf_counter() - begin, method, reason)
