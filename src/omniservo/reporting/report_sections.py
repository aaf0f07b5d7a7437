"""The report's sections, each a piece of HTML made from results."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from importlib.metadata import version

from omniservo.reporting.html import (
    Cell,
    ConstraintCard,
    Markup,
    constraint_cards,
    inlined,
    joined,
    judged,
    table,
    tag,
    tiles,
)
from omniservo.reporting.margins import certified_clearance, certified_visibility
from omniservo.reporting.metric_meanings import meaning_of, spell_contacts, spell_metric
from omniservo.reporting.paper_table import PAPER, comparison_table
from omniservo.reporting.promise_words import CERTIFIED, OUT_OF_VIEW
from omniservo.reporting.spelling import reads_less, spell, spell_bound
from omniservo.reporting.verdict import plan_sentence, planner_sentence, verdict_of
from omniservo.results.run_result import RunResult
from omniservo.run_methods import COMPARE, COMPARED, METHODS
from omniservo.tasks import shipped_tasks

_PACKAGES = ("omniservo", "numpy", "scipy", "numba", "mujoco", "opencv-contrib-python-headless", "matplotlib")

_VISIBILITY = "visibility_executed_px"


def title_of(result: RunResult) -> str:
    """Return the title of a run's method."""
    return METHODS[result.method].title if result.method in METHODS else result.method


def verdict(result: RunResult, *, named: bool) -> Markup:
    """Return the verdict's box; ``named``: with the method's name."""
    found = verdict_of(result)
    name = [tag("span", title_of(result), class_="method")] if named else []
    return judged(
        found.good,
        *name,
        tag("strong", found.word),
        tag("p", found.sentence),
        tag("p", plan_sentence(result), class_="quiet"),
        *([tag("p", why, class_="quiet")] if (why := planner_sentence(result)) else []),
        *(tag("p", f"Notice: {notice}.") for notice in result.notices),
    )


def refusal(method: str, why: str) -> Markup:
    """Return the box of a method that refused the task."""
    name = METHODS[method].title if method in METHODS else method
    return judged(False, tag("span", name, class_="method"), tag("strong", "Refused"), tag("p", f"{why}."))


def key_numbers(result: RunResult) -> Markup:
    """Return the few numbers that matter most, each beside the word that says whose it is."""
    return joined(
        [
            constraint_cards([*_distances(result), _in_view(result)]),
            tiles(
                [
                    _off_goal(result),
                    (
                        "Planned in",
                        spell(result.seconds.get("planning"), "s"),
                        f"motion and structure {spell(result.seconds.get('estimation'), 's')}{_code(result)}",
                    ),
                ]
            ),
        ]
    )


def _off_goal(result: RunResult) -> tuple[str, str, str]:
    """Return the tile of how far from the goal the camera came to rest: in space, where that is known."""
    place, turn, image = (
        spell_metric(name, result.metrics.get(name))
        for name in ("final_translation_error_m", "final_rotation_error_rad", "final_error_px")
    )
    if result.truth is None:
        return "Off the goal image (measured)", image, "rms; its place in space is not measured"
    return "Off the goal (measured)", place, f"{turn}, {image} rms in the image"


STAGES = ("perception", "estimation", "planning")
"""whose computing time is stated apart from that of loading code"""


def _code(result: RunResult) -> str:
    """Say what of planning and estimating was loading or compiling code, which is done once a process."""
    spent = sum(result.seconds.get(f"{stage}_code", 0.0) for stage in STAGES[1:])
    return f"; {spell(spent, 's')} of both was loading or compiling code" if spent else ""


def _distances(result: RunResult) -> list[ConstraintCard]:
    """Return the tiles of distances: the one that is required, and that of any link to any real body."""
    whole, planning, metrics = result.whole_arm, result.task.planning, result.metrics
    found = []
    if whole is not None and whole.asked is not None:
        proven = whole.proof.clearance if whole.proof.status == "clear" else None
        planned = metrics.get("link_clearance_planned_m")
        said = spell_metric("link_clearance_planned_m", planned)
        sampled = "" if planned is None else f"; sampled, the planned path keeps {said}"
        found.append(
            ConstraintCard(
                "Any link to what the planner knows",
                spell_metric("link_clearance_executed_m", metrics.get("link_clearance_executed_m")),
                spell_bound(proven, "m"),
                spell(whole.asked, "m"),
                f"The proof stops at what the path had to keep{sampled}.",
            )
        )
    elif planning.common_obstacles:
        proven = certified_clearance(result)
        found.append(
            ConstraintCard(
                "Camera's centre to the obstacles",
                spell_metric("clearance_executed_m", metrics.get("clearance_executed_m")),
                spell_bound(proven, "m"),
                spell(planning.clearance, "m"),
                _strayed(result, "clearance_executed_m", proven, "m") + _tracking(result),
            )
        )
    gap = metrics.get("arm_clearance_executed_m")
    if isinstance(gap, int | float):
        found.append(
            ConstraintCard(
                "Any link to any obstacle's body",
                spell(float(gap), "m"),
                note="Against the real bodies, as the simulator knows them; the planner knows what the task "
                "states.",
            )
        )
    return found


def _in_view(result: RunResult) -> ConstraintCard:
    proven = certified_visibility(result)
    return ConstraintCard(
        "Points to the image's limits",
        _said(result, _VISIBILITY),
        spell_bound(proven, "px"),
        spell(result.task.planning.visibility_margin, "px"),
        _strayed(result, _VISIBILITY, proven, "px"),
    )


def _strayed(result: RunResult, executed: str, proven: float | None, unit: str) -> str:
    """Return why less was executed than was certified; empty where what is written is not less."""
    measured, strayed = result.metrics.get(executed), result.metrics.get("path_deviation_m")
    if proven is None or not isinstance(measured, int | float) or not reads_less(measured, proven, unit):
        return ""
    by = f" by up to {spell(float(strayed), 'm')}" if isinstance(strayed, int | float) else ""
    return f"Less than certified: the proof is of the path, from which the arm deviated{by}. "


def _tracking(result: RunResult) -> str:
    """Return why more is certified than is required; empty where nothing is kept for tracking."""
    kept = result.task.planning.tracking_margin
    if kept <= 0.0 or result.plan is None:
        return ""
    return f"The path keeps {spell(kept, 'm')} more than required, for tracking errors."


def side_by_side(results: Sequence[RunResult]) -> Markup:
    """Return the table that compares methods: one column each, what is not good marked."""
    names = list(dict.fromkeys(name for r in results for name in r.metrics))
    skipped = {"task", "method", "status", "reason", "contacts", "clearance_asked_m"}
    rows: list[list[Cell]] = [
        ["Verdict", *(_marked(verdict_of(r).word, verdict_of(r).good) for r in results)],
        [
            meaning_of("contacts").label,
            *(_marked(spell_contacts(sorted(r.log.contacts)), not r.log.contacts) for r in results),
        ],
    ]
    for name in names:
        if name not in skipped:
            rows.append([meaning_of(name).label, *(_judged(r, name) for r in results)])
    return table(["", *(title_of(r) for r in results)], rows)


def paper_and_ours(result: RunResult) -> Markup | None:
    """Return the table paper / ours; None where the task is not one of the paper's."""
    rows = comparison_table(result)
    if not rows:
        return None
    example = PAPER[result.task.name].example
    return joined(
        [
            table(
                ["", f"paper, example {example}", "here", "unit"],
                [[r.quantity, r.paper, r.ours, r.unit] for r in rows],
            ),
            tag(
                "p",
                "The paper's times are those of its MATLAB program on a Pentium D; ours are those of this "
                f"run{_code(result)}. The paper's target and obstacle body are not published; those here are "
                "our reading of its figures.",
                class_="quiet",
            ),
        ]
    )


def metrics(result: RunResult) -> Markup:
    """Return every metric with its meaning and its name in metrics.json."""
    rows: list[list[Cell]] = [
        [meaning_of(name).label, _said(result, name), tag("code", name)] for name in result.metrics
    ]
    return table(["quantity", "value", "in metrics.json"], rows)


def certificate(result: RunResult) -> Markup | None:
    """Return the certificate's constraints, the tightest marked; None where there is none."""
    if result.plan is None or result.plan.certificate is None:
        return None
    worst = result.plan.certificate.worst
    rows: list[list[Cell]] = []
    for c in result.plan.certificate.constraints:
        tightest = c.name == getattr(worst, "name", worst)
        rows.append(
            [
                joined([c.name, tag("span", "worst", class_="badge")]) if tightest else c.name,
                spell_bound(c.margin, c.unit) if _is_certified(result) else spell(c.margin, c.unit),
                f"{c.w:.3f}",
            ]
        )
    lead = tag(
        "p",
        f"Plan: {result.plan.status}. A margin is what is left beyond what the problem requires (0: just "
        "met); of a certified constraint it is guaranteed for every w in [0, 1]. The last column says where "
        "the smallest value was found.",
    )
    return joined([lead, table(["constraint", "margin", "at w"], rows)])


def risk(result: RunResult) -> Markup | None:
    """Return what uncertainty takes of every constraint's margin; None where the task states no risk."""
    if result.risk is None:
        return None
    rows: list[list[Cell]] = [
        [
            name,
            spell(margin.planned, margin.unit),
            spell(margin.executed, margin.unit),
            spell(margin.extra, margin.unit),
            ", ".join(f"{source} {spell(taken, margin.unit)}" for source, taken in margin.parts.items()),
        ]
        for name, margin in result.risk.margins.items()
    ]
    lead = tag(
        "p",
        f"{100 * result.risk.predicted:.2g}% of {result.risk.samples} samples of what the estimate may truly "
        f"be violate a constraint (95% upper bound {100 * result.risk.predicted_bound:.2g}%, required "
        f"{100 * result.risk.risk:g}%). Margins are what is left beyond what the problem requires.",
    )
    columns = ["constraint", "planned", "left at that risk", "required in addition", "taken by"]
    return joined([lead, table(columns, rows), tag("p", result.risk.advice, class_="quiet")])


def timings(result: RunResult) -> Markup:
    """Return how long each stage took."""
    names = {
        "perception": "finding and matching the points of two images",
        "estimation": "motion and structure",
        "planning": "planning, certificate included",
        "looking_again": "looking again, simulation of the moves included",
        **{f"{stage}_code": "… of it loading or compiling code" for stage in STAGES},
        "control": "one control step, median",
        "whole": "the whole job, simulation and figures included",
    }
    rows = [[names.get(stage, stage), spell(value, "s")] for stage, value in result.seconds.items()]
    return table(["stage", "wall time"], rows)


def reproduce(results: Sequence[RunResult]) -> Markup:
    """Return the command that repeats the run, and the versions that made it."""
    first = results[0]
    name = first.task.name
    task, where = (name, "") if name in shipped_tasks() else ("TASK.yaml", f"TASK.yaml: the file of {name}. ")
    names = tuple(_called(r.method) for r in results)
    method = COMPARE if names == COMPARED else " --method ".join(names)
    seed = f" --seed {first.metrics['seed']}" if "seed" in first.metrics else ""
    robot = "" if first.truth is not None else " --on ROBOT.yaml --goal goal.json"
    versions = [f"{package} {version(package)}" for package in _PACKAGES]
    return joined(
        [
            tag("pre", tag("code", f"omniservo run {task} --method {method}{seed}{robot}")),
            tag("p", f"{where}Python {platform.python_version()}, {', '.join(versions)}.", class_="quiet"),
        ]
    )


def _called(method: str) -> str:
    """Return what ``--method`` takes: FILE.py:CLASS for a method from a file."""
    return method if method in METHODS else ".py:".join(method.rsplit(".", 1))


def animation(data: bytes, result: RunResult) -> Markup:
    """Return the animation as a figure."""
    camera = "the eye-in-hand camera, with the feature trajectories (orange) and rings where the goal image "
    words = f"{camera}has them (blue)"
    words = f"Left: {words}. Right: the arm from outside" if result.outside else words[:1].upper() + words[1:]
    words = f"{words}. In the run's own time."
    return tag(
        "figure", inlined(data, "gif", f"animation of the {result.method} run"), tag("figcaption", words)
    )


def _is_certified(result: RunResult) -> bool:
    return result.plan is not None and result.plan.status == "certified"


def _said(result: RunResult, name: str) -> str:
    """Return a metric for people; what its label calls certified is a bound, or said not to be certified."""
    value = result.metrics.get(name)
    if name == _VISIBILITY and value is None and result.log.has_truth:
        return OUT_OF_VIEW
    if not isinstance(value, int | float) or not meaning_of(name).label.endswith(CERTIFIED):
        return spell_metric(name, value)
    unit = meaning_of(name).unit
    return spell_bound(value, unit) if _is_certified(result) else f"{spell(value, unit)}, not certified"


def _marked(words: str, good: bool) -> Markup:
    return tag("span", words, class_="ok" if good else "no")


def _judged(result: RunResult, name: str) -> Cell:
    """Return a metric, marked where it breaks what the task requires."""
    value = result.metrics.get(name)
    words = _said(result, name)
    if not isinstance(value, int | float):
        return _marked(words, good=False) if words == OUT_OF_VIEW else words
    least = {
        "clearance_executed_m": result.task.planning.clearance,
        "arm_clearance_executed_m": 0.0,
        _VISIBILITY: result.task.planning.visibility_margin,
    }.get(name)
    return words if least is None else _marked(words, value > least or value == least != 0.0)
