"""What a run came to, in the few lines that a person reads; metrics.json has the rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from omniservo.reporting.metric_meanings import meaning_of, spell_contacts, spell_metric
from omniservo.reporting.promise_words import OUT_OF_VIEW
from omniservo.reporting.spelling import spell, spell_bound

_STAGES = ("estimation", "planning")


def run_summary(metrics: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines of one run, from what metrics.json holds of it."""
    yield f"{how_it_ended(metrics)}"
    if metrics["status"] == "refused":
        return
    if metrics["clearance_executed_m"] is not None:
        asked = f" ({_of(metrics, 'clearance_asked_m')} required)" if metrics["clearance_asked_m"] else ""
        yield (
            f"camera to obstacles   {_planned(metrics, 'clearance_planned_m')}, "
            f"{_of(metrics, 'clearance_executed_m')} executed{asked}"
        )
    yield from _links(metrics)
    yield f"points in view by     {_planned(metrics, 'visibility_planned_px')}, {_in_view(metrics)}"
    if metrics.get("looks"):
        nothing = f", {count} × for nothing" if (count := metrics["looks_for_nothing"]) else ""
        yield (
            f"looked again          {metrics['looks']} ×{nothing}; goal's position known to "
            f"{_of(metrics, 'goal_sigma_before_looks_m')} (1σ) before, "
            f"{_of(metrics, 'goal_sigma_after_looks_m')} after"
        )
    yield f"computing             {_times(metrics)}"
    for notice in metrics.get("notices", ()):
        yield f"notice                {notice}"


def how_it_ended(metrics: Mapping[str, Any]) -> str:
    """Return the line that says whether the job is done, and how well."""
    status = metrics["status"]
    if status == "contact":
        return f"touched: {spell_contacts(metrics['contacts'])}"
    if status != "converged":
        return f"{status}: {metrics['reason']}"
    names = ("final_translation_error_m", "final_rotation_error_rad", "final_error_px")
    known = [name for name in names if metrics[name] is not None]
    off = ", ".join(_of(metrics, name) for name in known)
    real = metrics["final_translation_error_m"] is None  # no ground truth
    touched = "whether anything was touched is not measured" if real else "nothing was touched"
    return f"converged: {off} off the taught view; {touched}"


def _links(metrics: Mapping[str, Any]) -> Iterator[str]:
    told = (metrics["arm_clearance_executed_m"], metrics.get("link_clearance_executed_m"))
    measured = [gap for gap in told if gap is not None]
    if not measured:
        return
    asked = metrics.get("link_clearance_asked_m")
    more = "" if asked is None else f" ({spell(asked, 'm')} required)"
    yield f"any link to anything  {spell(min(measured), 'm')} executed{more}"


def _times(metrics: Mapping[str, Any]) -> str:
    told = [f"motion and structure {_of(metrics, 'estimation_seconds')}"]
    if metrics["planning_seconds"] is not None:
        told.append(f"planning {_of(metrics, 'planning_seconds')}")
    code = sum(metrics.get(f"{stage}_code_seconds", 0.0) for stage in _STAGES)
    loading = f" ({spell(code, 's')} of both was loading or compiling code)" if code else ""
    return f"{', '.join(told)}{loading}; the motion took {_of(metrics, 'servo_seconds')}"


def _in_view(metrics: Mapping[str, Any]) -> str:
    known = metrics["final_translation_error_m"] is not None  # the truth
    if metrics["visibility_executed_px"] is None and known:
        return f"but {OUT_OF_VIEW}"
    return f"{_of(metrics, 'visibility_executed_px')} executed"


def _planned(metrics: Mapping[str, Any], name: str) -> str:
    if metrics["plan_status"] == "certified":
        return f"{spell_bound(metrics[name], meaning_of(name).unit)} certified"
    return f"{_of(metrics, name)} planned"


def _of(metrics: Mapping[str, Any], name: str) -> str:
    return spell_metric(name, metrics[name])
