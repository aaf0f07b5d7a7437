"""One row of a study: a closed loop, and how it is scored against the truth."""

from __future__ import annotations

import traceback
from dataclasses import asdict, dataclass, fields, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from omniservo.planning import Plan
from omniservo.studies.closed_loop import ClosedLoop
from omniservo.studies.program import PACKAGE, Program
from omniservo.studies.scene_start import scene_start
from omniservo.studies.study import Study
from omniservo.studies.study_arms import NO_ARM
from omniservo.studies.study_controller import NotLed, controller_of_scene
from omniservo.studies.study_scene import NoScene, StudyScene
from omniservo.studies.trajectory import Trajectory

STATUSES = ("converged", "timed_out", "stopped", "not_estimated", "not_planned", "no_scene", "error")

_LONGEST_REASON = 500

DIVERGED = 2.0
"""times as far from the goal as start and target, a camera was led away"""


@dataclass(frozen=True)
class StudyRow:
    """A row's numbers: a pure function of the study, its own number and the program."""

    row: int
    study_hash: str
    version: str
    seed: int
    """of the study"""
    method: str
    camera: str
    status: str
    """one of `STATUSES`"""
    reason: str
    success: bool
    """the final errors are within the study's limits, and there was no collision"""
    collision: bool
    """the camera's centre came nearer to an obstacle's surface than the clearance, or a link or the camera's
    housing touched an obstacle, the floor or another link"""
    feature_lost: bool
    """a point of the target left the image on the way, or an obstacle hid it"""
    final_translation_error_m: float | None
    """of the true last pose; None: there was no scene, or an error"""
    final_rotation_error_rad: float | None
    seconds: float | None
    """of the run, not of computing it"""
    path_length_m: float | None
    least_gap_m: float | None
    """of the camera's centre to an obstacle's surface; None: there is no obstacle"""
    diverged: bool
    """the camera was led away: its final errors are not within the limits, and its centre was once twice as
    far from the goal as start and target, whichever of the two is farther"""
    images: int
    """that were taken on the way"""
    certified: bool
    """there is a plan with a certificate"""
    scene: int
    """alike for all methods"""
    start_rotation_rad: float | None
    start_distance_ratio: float | None
    start_distance_m: float | None
    """of the start from the goal"""
    obstacles: int
    noise_px: float | None
    latency_s: float | None
    arm: str
    """by the study's name; "none": the camera moves freely, or there was no scene"""
    joint_limit: bool
    """the arm was stopped because a joint would have left its range, or because it was singular"""
    least_link_gap_m: float | None
    """of links and the camera's housing to obstacles and the floor, at most 0.4; negative: depth; None: there
    is no arm, or it never moved"""
    obstacle_moved_s: float | None
    """when a ball was put elsewhere; None: none was"""

    @property
    def counts(self) -> bool:
        """Whether it says anything of the method: there was a scene."""
        return self.status != "no_scene"


COLUMNS = tuple(field.name for field in fields(StudyRow))


@dataclass(frozen=True, eq=False)
class RowResult:
    """A row with what it was made of."""

    row: StudyRow
    plan: Plan | None = None
    scene: StudyScene | None = None
    trajectory: Trajectory | None = None

    def plan_fields(self) -> dict[str, Any] | None:
        """Return the file of a certified plan, without the time that it took."""
        return {**self.plan.to_dict(), "seconds": 0.0} if self.plan and self.row.certified else None


def run_row(study: Study, number: int, program: Program = PACKAGE) -> RowResult:
    """Run row ``number``; whatever goes wrong in it is a row, too."""
    scene_number, camera, method = study.place(number)
    empty = StudyRow(
        row=number, study_hash=study.hash, version=program.version, seed=study.seed, method=method,
        camera=camera, status="error", reason="", success=False, collision=False, feature_lost=False,
        final_translation_error_m=None, final_rotation_error_rad=None, seconds=None, path_length_m=None,
        least_gap_m=None, diverged=False, images=0, certified=False, scene=scene_number,
        start_rotation_rad=None, start_distance_ratio=None, start_distance_m=None, obstacles=0,
        noise_px=None, latency_s=None, arm=NO_ARM, joint_limit=False, least_link_gap_m=None,
        obstacle_moved_s=None,
    )  # fmt: skip
    try:
        result = _run(study, empty, program)
        refuse_not_finite(result.row)
        return replace(result, row=replace(result.row, reason=_printable(result.row.reason)))
    except (Exception, SystemExit) as error:  # of a method from a file, which may do anything
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}:{place.lineno}"
        return RowResult(replace(empty, reason=_printable(f"{type(error).__name__}: {error} ({where})")))


def refuse_not_finite(row: StudyRow) -> None:
    """Refuse a row with a number that is none.

    Raises:
        ValueError: one is NaN or infinite.
    """
    for name, value in fields_of_row(row).items():
        if isinstance(value, float) and not isfinite(value):
            raise ValueError(f"{name} is {value}")


def _printable(reason: str) -> str:
    """Return a reason as tables hold it: of one line, and not longer than `_LONGEST_REASON`."""
    return "".join(c if c.isprintable() else "\ufffd" for c in reason[:_LONGEST_REASON])


def _run(study: Study, empty: StudyRow, program: Program) -> RowResult:
    start = scene_start(study, empty.scene, empty.camera)
    if isinstance(start, NoScene):
        return RowResult(replace(empty, status="no_scene", reason=str(start)))
    scene = start.scene
    drawn = replace(
        empty,
        arm=NO_ARM if scene.arm is None else scene.arm.name,
        start_rotation_rad=scene.drawn.rotation,
        start_distance_ratio=scene.drawn.distance_ratio,
        start_distance_m=float(np.linalg.norm(scene.initial_T_goal.translation)),
        obstacles=len(scene.obstacles),
        noise_px=scene.conditions.noise,
        latency_s=scene.conditions.latency,
        obstacle_moved_s=None if scene.moved is None else scene.moved.time,
    )
    try:
        led = controller_of_scene(study, start, program, empty.method)
    except NotLed as none:
        still = Trajectory.standing()
        row = scored(study, scene, replace(drawn, status=none.status, reason=none.reason), still)
        return RowResult(row, None, scene, still)
    certified = led.plan is not None and led.plan.status == "certified"
    ended = ClosedLoop(study, scene, start.camera(), led).run()
    said = replace(
        drawn,
        status=ended.status,
        reason=ended.reason,
        joint_limit=ended.joint_limit,
        certified=certified,
    )
    return RowResult(scored(study, scene, said, ended.trajectory), led.plan, scene, ended.trajectory)


def scored(study: Study, scene: StudyScene, row: StudyRow, trajectory: Trajectory) -> StudyRow:
    """Return the row with what the true poses say of it."""
    off = scene.initial_T_goal.inv() * trajectory.end
    translation, rotation = float(np.linalg.norm(off.translation)), float(off.rotation.magnitude())
    gap = trajectory.least_gap(scene)
    links, touch = None, False
    if scene.arm is not None and trajectory.joints:
        links, touch = trajectory.nearness(scene.arm, scene)
    collision = touch or (gap is not None and gap < scene.clearance)
    goal = np.array(scene.initial_T_goal.translation)
    far = max(float(np.linalg.norm(goal)), scene.drawn.distance)
    near = translation <= study.limits.translation and rotation <= study.limits.rotation
    return replace(
        row,
        success=bool(near and not collision),
        collision=collision,
        feature_lost=trajectory.feature_lost,
        final_translation_error_m=translation,
        final_rotation_error_rad=rotation,
        seconds=trajectory.times[-1],
        path_length_m=trajectory.length,
        least_gap_m=gap,
        least_link_gap_m=links,
        diverged=bool(not near and trajectory.farthest(goal) > DIVERGED * far),
        images=trajectory.images,
    )


_KINDS: dict[str, tuple[type, ...]] = {
    "int": (int,), "str": (str,), "bool": (bool,), "float | None": (float, type(None)),
}  # fmt: skip


def row_of_fields(given: dict[str, Any]) -> StudyRow:
    """Return the row of a part's line.

    Raises:
        ValueError: a field is missing, unknown, of another type, or not finite.
    """
    if set(given) != set(COLUMNS):
        raise ValueError("other columns")
    for field in fields(StudyRow):
        value = given[field.name]
        if type(value) not in _KINDS[str(field.type)]:
            raise ValueError(f"{field.name}: {value!r}")
    row = StudyRow(**given)
    refuse_not_finite(row)
    return row


def fields_of_row(row: StudyRow) -> dict[str, Any]:
    """Return a row's columns in their order."""
    return asdict(row)
