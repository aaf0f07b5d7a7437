"""What each number of metrics.json means, for people."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from omniservo.reporting.promise_words import CERTIFIED, EXECUTED, REQUIRED
from omniservo.reporting.spelling import NOTHING, spell


@dataclass(frozen=True)
class Meaning:
    """A metric in words."""

    label: str
    unit: str
    """as in metrics.json: "m", "rad", "px", "s", "share" (of 1), or "" where it is not a quantity"""


_CENTRE = "Camera's centre to the obstacles"
_LINKS = "Any link to what the planner knows"

_MEANINGS = {
    "task": Meaning("Task", ""),
    "method": Meaning("Method", ""),
    "status": Meaning("Final status", ""),
    "reason": Meaning("Why it was stopped", ""),
    "plan_status": Meaning("Plan", ""),
    "notices": Meaning("Notices on the problem", ""),
    "arm_notices": Meaning("What of the arm's file was left out, and which shapes are not kept apart", ""),
    "clearance_asked_m": Meaning(f"{_CENTRE}, {REQUIRED}", "m"),
    "clearance_planned_m": Meaning(f"{_CENTRE}, {CERTIFIED}", "m"),
    "clearance_executed_m": Meaning(f"{_CENTRE}, {EXECUTED}", "m"),
    "arm_clearance_executed_m": Meaning(f"Any link to any obstacle's body, {EXECUTED}", "m"),
    "arm_clearance_proof": Meaning(f"{_LINKS}, proof on the planned path", ""),
    "link_clearance_asked_m": Meaning(f"{_LINKS}, {REQUIRED}", "m"),
    "link_margin_estimate_m": Meaning("… what the uncertain estimate takes of a link's gap", "m"),
    "link_margin_mount_m": Meaning("… what the uncertain camera mount takes of a link's gap", "m"),
    "link_margin_added_m": Meaning("… clearance planned with for both", "m"),
    "link_margin_tracking_m": Meaning("… kept for tracking errors of a link, largest", "m"),
    "camera_margin_tracking_m": Meaning("Kept for tracking errors of the camera", "m"),
    "visibility_margin_tracking_px": Meaning("Kept for tracking errors in the image", "px"),
    "link_clearance_planned_m": Meaning(f"{_LINKS}, planned path, sampled", "m"),
    "link_clearance_executed_m": Meaning(f"{_LINKS}, {EXECUTED}", "m"),
    "visibility_planned_px": Meaning(f"Points to the image's limits, {CERTIFIED}", "px"),
    "visibility_executed_px": Meaning(f"Points to the image's limits, {EXECUTED}", "px"),
    "final_error_px": Meaning("At the goal: image error, rms", "px"),
    "final_translation_error_m": Meaning("At the goal: position error (truth)", "m"),
    "final_rotation_error_rad": Meaning("At the goal: rotation error (truth)", "rad"),
    "path_deviation_m": Meaning("Largest deviation from the planned path", "m"),
    "servo_seconds": Meaning("Duration of the motion", "s"),
    "frames": Meaning("Images used by the controller", ""),
    "recorded_images": Meaning("Images in the recording", ""),
    "recorded_images_dropped": Meaning("… missing, because the disk was too slow", ""),
    "lost_points": Meaning("Points not found, over all images", ""),
    "filtered_frames": Meaning(
        "Commands that the visibility filter changed, so that points stay in view", ""
    ),
    "contacts": Meaning("Bodies that touched", ""),
    "estimate_rms_px": Meaning("Residual of motion and structure, rms", "px"),
    "perception_seconds": Meaning("Time: finding and matching the points", "s"),
    "perception_code_seconds": Meaning("… of it loading or compiling code", "s"),
    "estimation_seconds": Meaning("Time: motion and structure", "s"),
    "estimation_code_seconds": Meaning("… of it loading or compiling code", "s"),
    "risk_asked": Meaning("Risk allowed: some constraint is violated because of uncertainty", "share"),
    "risk_of_camera": Meaning("… of it: a constraint of the camera, because of the estimate", "share"),
    "risk_of_links": Meaning("… of it: a gap of the arm, because of estimate and mount", "share"),
    "risk_of_tracking": Meaning("… of it: the run leaves the tracking tube", "share"),
    "risk_predicted": Meaning("Risk predicted from samples of the estimate", "share"),
    "risk_predicted_bound": Meaning("… its 95% upper bound", "share"),
    "clearance_for_uncertainty_m": Meaning("Most that was added to a distance for uncertainty", "m"),
    "visibility_for_uncertainty_px": Meaning("Added to the visibility margin for uncertainty", "px"),
    "joint_limit_margin_rad": Meaning("Smallest joint-limit margin, planned", "rad"),
    "singular_value_least": Meaning("Smallest singular value of the arm, planned", "1"),
    "joint_speed_share": Meaning("Highest joint speed planned, of its limit", "share"),
    "joint_acceleration_share": Meaning("Highest joint acceleration planned, of its limit", "share"),
    "joint_speed_share_executed": Meaning("Highest joint speed executed, image to image", "share"),
    "image_speed_planned_px_s": Meaning("Fastest followed point in the image, planned", "px/s"),
    "motion_seconds": Meaning("Time of the motion planned", "s"),
    "time_optimal_seconds": Meaning("… the fastest within the same limits", "s"),
    "changes_on_the_way": Meaning("Changes during the motion: of obstacles, or of the estimate", ""),
    "replanned": Meaning("… after which another path was followed", ""),
    "replanning_seconds": Meaning("Time: replanning, longest", "s"),
    "replanning_twist_jump": Meaning("Jump of the reference's twist there [m/s or rad/s]", ""),
    "replanning_joint_jump": Meaning("… of its joints' speeds [rad/s]", ""),
    "waits": Meaning("Times when the arm waited for images", ""),
    "waited_seconds": Meaning("… altogether, slowing down included", "s"),
    "moved_blind_m": Meaning("… farthest that the camera moved between two images then", "m"),
    "looks": Meaning("Looks before the plan", ""),
    "looks_for_nothing": Meaning("… of them gave nothing", ""),
    "looking_again_seconds": Meaning("… time with the simulation of their moves", "s"),
    "looks_motion_seconds": Meaning("… time that their moves took", "s"),
    "looks_computing_seconds": Meaning("… time to choose them and join their images", "s"),
    "goal_sigma_before_looks_m": Meaning("… standard deviation of the goal's position before", "m"),
    "goal_sigma_after_looks_m": Meaning("… and after", "m"),
    "points_sigma_before_looks_m": Meaning("… standard deviation of the points before", "m"),
    "points_sigma_after_looks_m": Meaning("… and after", "m"),
    "planning_seconds": Meaning("Time: planning", "s"),
    "planning_code_seconds": Meaning("… of it loading or compiling code", "s"),
    "control_seconds_median": Meaning("Time: one control step, median", "s"),
    "whole_seconds": Meaning("Time: the whole job, simulation included", "s"),
}

_ENDINGS = {"_m": "m", "_rad": "rad", "_px": "px", "_seconds": "s"}


def meaning_of(name: str) -> Meaning:
    """Return a metric's meaning; an unknown one keeps its name and gets its unit by its ending."""
    known = _MEANINGS.get(name)
    if known is not None:
        return known
    unit = next((u for ending, u in _ENDINGS.items() if name.endswith(ending)), "")
    return Meaning(name.replace("_", " ").capitalize(), unit)


def metrics_in_words() -> dict[str, str]:
    """Return what each known metric means, with its unit."""
    return {name: f"{m.label} [{m.unit}]" if m.unit else m.label for name, m in _MEANINGS.items()}


def spell_metric(name: str, value: object) -> str:
    """Return a metric's value for people."""
    if value is None or value == "":
        return NOTHING
    if isinstance(value, list | tuple | set | frozenset):
        return spell_contacts(value) if name == "contacts" else ", ".join(map(str, value)) or NOTHING
    if isinstance(value, Mapping):
        return ", ".join(f"{k}: {v}" for k, v in value.items())
    unit = meaning_of(name).unit
    if unit and isinstance(value, int | float) and not isinstance(value, bool):
        return spell(float(value), unit)
    return str(value)


def spell_contacts(pairs: Iterable[object]) -> str:
    """Return pairs of bodies that touched, or "none"."""
    words = [" and ".join(map(str, p)) if isinstance(p, list | tuple) else str(p) for p in pairs]
    return "; ".join(words) or "none"
