"""How a run ended, in one sentence."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.reporting.metric_meanings import spell_contacts
from omniservo.reporting.paper_table import PAPER
from omniservo.reporting.spelling import spell
from omniservo.results.run_result import RunResult
from omniservo.risk import RiskPlan
from omniservo.tasks.obstacles import SphereSection


@dataclass(frozen=True)
class Verdict:
    """How a run ended."""

    good: bool
    word: str
    sentence: str


def verdict_of(result: RunResult) -> Verdict:
    """Return the verdict: contact first, then what stopped the arm, then how well it converged."""
    if result.log.contacts:
        pairs = spell_contacts(sorted(result.log.contacts))
        row = next((row for row in result.log.rows if row.arm_clearance <= 0.0), None)
        when = "" if row is None else f", first at {row.time:.2f} s"
        then = f" Then it stopped: {result.log.stop_message}." if result.log.stop_reason else ""
        return Verdict(False, "Touched", f"The arm touched something: {pairs}{when}.{then}")
    if result.log.stop_reason:
        reason = result.log.stop_reason.replace("_", " ")
        return Verdict(False, f"Stopped: {reason}", f"{_capital(result.log.stop_message)}.")
    errors = [
        spell(float(value), unit)
        for name, unit in (("final_translation_error_m", "m"), ("final_rotation_error_rad", "rad"))
        if isinstance(value := result.metrics.get(name), int | float)
    ]
    off = f", {' and '.join(errors)} off" if errors else ""
    return Verdict(True, "Converged", f"The camera stands at the goal{off}; {_nearest(result)}.")


def _nearest(result: RunResult) -> str:
    if result.truth is None:
        return "whether anything was touched is not measured on a real robot"
    gap = result.metrics.get("arm_clearance_executed_m")
    if not isinstance(gap, int | float):
        return "nothing was touched"
    return f"nothing was touched: the smallest distance of any link to any obstacle was {spell(gap, 'm')}"


def planner_sentence(result: RunResult) -> str:
    """Return why the path keeps away from points in free air; empty where the planner was given bodies."""
    given = result.task.planning.obstacles
    whole, gap = result.whole_arm, result.metrics.get("arm_clearance_executed_m")
    if not given or not result.task.obstacles or (whole is not None and whole.asked is not None):
        return ""
    if result.plan is None or not all(isinstance(section, SphereSection) for section in given):
        return ""
    who = "the paper" if result.task.name in PAPER else "the task"
    near = f", which the arm passed at {spell(float(gap), 'm')}" if isinstance(gap, int | float) else ""
    return (
        f"The path keeps away from {len(given)} points in free air because {who} states its obstacle as "
        f"these points. The brick-red body{near}, was not given to the planner: that distance is measured, "
        "not promised."
    )


def plan_sentence(result: RunResult) -> str:
    """Return what the plan promised."""
    if result.plan is None:
        return "Nothing was planned: the goal image is the reference from the start."
    if result.plan.status == "certified":
        proven = "The path was certified: every constraint is proven for the whole path, not sampled."
        return proven if result.risk is None else f"{proven} {_risk_sentence(result.risk)}"
    why = f" {_capital(result.plan.reason)}." if result.plan.reason else ""
    return f"The path was followed although its certificate says: {result.plan.status}.{why}"


def _risk_sentence(risk: RiskPlan) -> str:
    return (
        f"Its margins are so wide that an estimate as uncertain as this one leaves a constraint unmet with "
        f"a probability of at most {100 * risk.predicted_bound:.2g}% (required: {100 * risk.risk:g}%)."
    )


def _capital(sentence: str) -> str:
    stripped = sentence.strip().rstrip(".")
    return stripped[:1].upper() + stripped[1:]
