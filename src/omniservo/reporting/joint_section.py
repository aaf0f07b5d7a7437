"""The report's section on joints and time."""

from __future__ import annotations

import numpy as np

from omniservo.reporting.html import Cell, Markup, joined, table, tag, whole
from omniservo.reporting.spelling import NOTHING, spell
from omniservo.results.run_result import RunResult
from omniservo.robots import JointPath
from omniservo.tracking.planned_motion import PlannedMotion

_LAWS = {
    "rest-to-rest": "the rest-to-rest law",
    "time-optimal": "the time-optimal law",
    "exponential": "the paper's exponential law (42)",
}


def joint_section(result: RunResult) -> Markup | None:
    """Return what the plan requires of the joints, and what other branches would; None without a plan."""
    if result.motion is None:
        return None
    motion = result.motion
    return joined(
        [
            tag("p", _words(result, motion)),
            _joints(motion),
            tag("h3", "Every branch in which the arm could begin"),
            _branches(motion),
            tag("p", _how_many(motion), class_="quiet"),
        ]
    )


def _words(result: RunResult, motion: PlannedMotion) -> str:
    least, place = motion.least_singular_value
    fastest = spell(motion.time_optimal_seconds, "s")
    speed = result.task.servo.image_speed
    bounds = "half of the arm's joint speeds and accelerations"
    if speed is not None:
        bounds += f" and {speed:g} px/s in the image"
    law = _LAWS[result.task.servo.time_law]
    return (
        f"The arm follows the plan from where it stands. Its smallest singular value is {least:.3f}, at "
        f"w = {place:.3f}. With {law} the motion takes {spell(motion.seconds, 's')}; the fastest within "
        f"{bounds} would take {fastest}."
    )


def _joints(motion: PlannedMotion) -> Markup:
    margins, places = motion.least_margins
    times = motion.times()
    speeds, accelerations = motion.speed_shares(times), motion.acceleration_shares(times)
    rows: list[list[Cell]] = []
    for i, name in enumerate(motion.arm.joint_names):
        share = NOTHING if accelerations is None else spell(float(accelerations[:, i].max()), "share")
        low, high = np.rad2deg(motion.arm.joint_range[i])
        rows.append(
            [
                name,
                f"{low:.1f} … {high:.1f}°".replace("-", "−"),
                spell(float(margins[i]), "rad"),
                f"{places[i]:.3f}",
                spell(float(speeds[:, i].max()), "share"),
                share,
            ]
        )
    head = ["joint", "range", "joint-limit margin", "at w", "top speed", "top acceleration"]
    return table(head, rows)


def _branches(motion: PlannedMotion) -> Markup:
    others = [branch for branch in motion.others.branches if not motion.is_own(branch)]
    rows: list[list[Cell]] = []
    for branch in (motion.joints, *others):
        start = ", ".join(f"{angle:z.0f}" for angle in np.rad2deg(branch.positions[0])).replace("-", "−")
        own = branch is motion.joints
        own_mark = [tag("span", "its own", class_="badge")] if own else []
        rows.append([joined([whole(start), *own_mark])])
        rows[-1] += _verdict(branch)
    return table(
        ["starts at [deg]", "", "joint-limit margin", "singular value", "longest joint travel"], rows
    )


def _verdict(branch: JointPath) -> list[Cell]:
    words: Cell = tag("span", "can follow", class_="ok")
    room = float(branch.limit_margins.min())
    if not branch.feasible:
        words = joined([tag("span", "cannot", class_="no"), f" {branch.failures[0]}"])
        room = min([room, *(-f.amount for f in branch.failures if f.kind == "limit")])
    value = f"{branch.singular_values.min():.3f}"
    return [words, spell(room, "rad"), value, spell(branch.travel, "s")]


def _how_many(motion: PlannedMotion) -> str:
    found = motion.others
    if found.all_tried:
        words = "These are all; of the full turns each has those that leave the largest joint-limit margin."
    else:
        words = "The others were found by a search, which may miss some."
    return (
        f"{words} Margin and singular value are the smallest up to where a branch ends; a joint's "
        "travel is the time that it takes at full speed."
    )
