"""What the planner says, in words and numbers, as HTML."""

from __future__ import annotations

from html import escape

import numpy as np

from omniservo.reporting.spelling import spell, spell_bound
from omniservo.viewer.answer import Answer, Verdict

_COLOURS = {"certified": "#00873d", "no path": "#c4161c", "searching": "#b36b00"}

_SMALL = "margin:6px 8px;line-height:1.35;overflow-wrap:anywhere"
_NUMBER = "text-align:right;white-space:nowrap;padding-left:8px"

_SHOWN = 6
"""rows of the certificate"""


def _sign(verdict: Verdict) -> str:
    return (
        f"background:{_COLOURS[verdict]};color:white;border-radius:4px;padding:6px 10px;margin:0 8px 4px;"
        "font-size:15px;line-height:1.3;overflow-wrap:anywhere"
    )


def status_html(answer: Answer) -> str:
    """Return the verdict as a sign, what is tight or stands against a path, and the certificate's numbers.

    The sign carries number and verdict as attributes, which whoever watches the page can read.
    """
    verdict = answer.verdict
    attributes = f'data-update="{answer.number}" data-verdict="{verdict}" data-stage="{_stage(answer)}"'
    said: Verdict = "certified" if answer.camera_alone else verdict
    words = f"<b>{said.upper()}</b> {_what(answer)}"
    sign = f'<div {attributes} role="status" style="{_sign(said)}">{words}</div>'
    return sign + _against(answer) + _numbers(answer)


PLANNING = f'<div data-verdict="searching" role="status" style="{_sign("searching")}"><b>PLANNING</b> …</div>'
"""The sign while there is no answer yet."""


def refused_html(message: str) -> str:
    """Return the sign of a situation that cannot be planned for."""
    sign = _sign("no path")
    return f'<div data-verdict="refused" role="status" style="{sign}"><b>REFUSED</b> {escape(message)}</div>'


def job_html(words: str) -> str:
    """Return what a run does or did."""
    return f'<div data-job="">{note_html(words)}</div>'


def note_html(words: str) -> str:
    """Return words as they are: names of files and messages may look like markup."""
    return f'<div style="{_SMALL};font-size:12px">{escape(words)}</div>'


def _stage(answer: Answer) -> str:
    if answer.risk_plan is not None:
        return "risk"
    return "camera" if answer.arm_plan is None else "arm"


def _what(answer: Answer) -> str:
    if answer.situation.risk:
        return _at_risk(answer)
    milliseconds = 1e3 * (answer.camera_plan.seconds if answer.arm_plan is None else answer.arm_plan.seconds)
    if answer.camera_alone:
        return "camera's path; of the whole arm not yet"
    if answer.searching:
        return "the camera's path is certified; for the whole arm…"
    whose = "camera's path" if answer.arm_plan is None else "whole arm"
    return f"{whose}, {milliseconds:.1f} ms"


def _at_risk(answer: Answer) -> str:
    """Say what is planned for, and what samples of the estimate's error say of the plan."""
    stated, found = f"at a risk of {_percent(answer.situation.risk)}", answer.risk_plan
    if found is None:
        whether = "is" if answer.camera_plan.status == "certified" else "is not"
        return f"{stated}: this takes seconds …; the path without a risk {whether} certified"
    violated, bound = found.predicted, found.predicted_bound
    links = "" if found.links is None else f", links {_percent(found.links.violated)}"
    return (
        f"{stated}: {_percent(violated)} of {found.samples} samples violate a constraint "
        f"(95% bound: {_percent(bound)}){links}; {found.seconds:.1f} s"
    )


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g}%"


def _against(answer: Answer) -> str:
    worst = answer.worst
    if answer.verdict == "certified":
        words = "" if worst is None else f"tightest: {worst.words}"
    else:
        words = answer.reason or ("" if worst is None else worst.words)
    return note_html(words) if words else ""


def _numbers(answer: Answer) -> str:
    """Return the certificate's rows with the least left."""
    certificate = answer.plan.certificate
    if certificate is None:
        return ""
    proven = answer.plan.status == "certified"
    problem = answer.plan.problem
    distance = float(np.linalg.norm(problem.points, axis=1).mean())
    size = {"m": distance, "px": abs(problem.camera.fx), "rad": 1.0, "1": 1.0}
    rows = sorted(certificate.constraints, key=lambda c: c.margin / size[c.unit])[:_SHOWN]
    cells = "".join(
        f'<tr><td>{escape(c.name)}</td><td style="{_NUMBER}">'
        f"{spell_bound(c.margin, c.unit) if proven else spell(c.margin, c.unit)}</td>"
        f'<td style="{_NUMBER}">{c.w:.2f}</td></tr>'
        for c in rows
    )
    head = "left, proven" if proven else "least seen"
    more = len(certificate.constraints) - len(rows)
    rest = f" and {more} more" if more > 0 else ""
    return (
        f'<div style="{_SMALL};font-size:11px"><table style="width:100%;border-spacing:0">'
        f'<tr style="opacity:.75"><td>constraint{rest}</td><td style="{_NUMBER}">{head}</td>'
        f'<td style="{_NUMBER}">at w</td></tr>{cells}</table></div>'
    )
