"""Where there is no plan: the arm moves a little, takes an image, and it is planned again with both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TypeAlias

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import unified_image
from omniservo.errors import InputError, NoSolutionError
from omniservo.estimation import TwoViewEstimate
from omniservo.estimation.arm_views import (
    GOAL,
    ArmViews,
    ArmViewsOptimum,
    KnownErrors,
    LengthPrior,
    chain_of,
)
from omniservo.estimation.estimate_arm_views import estimate_arm_views
from omniservo.geometry.adjoint import adjoint
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray
from omniservo.looks import (
    NextLook,
    ViewingState,
    next_look,
    uncertainty_parts,
    uncertainty_size,
    what_is_missing,
)
from omniservo.perception import MatchedPoints
from omniservo.planning import Plan
from omniservo.results import Known, Seen, TakenLook
from omniservo.risk import RiskPlan, plan_arm_with_risk
from omniservo.robots import JointPath
from omniservo.runs.arm_setting_of import arm_setting_of, tube_of
from omniservo.runs.begun_elsewhere import begun_elsewhere
from omniservo.runs.estimate_task import estimate_task
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.followed_points import followed_points, shown_at_ends
from omniservo.runs.job_progress import Progress
from omniservo.runs.no_path import NoPath
from omniservo.runs.plan_task import mount_covariance_of, plan_task, problem_without_tube, risk_of_plan
from omniservo.runs.see import see
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal
from omniservo.whole_arm import plan_with_arm

JOIN_PX = 0.25
"""Points of two matches are one where they lie as near to each other in the image that both have."""


@dataclass(frozen=True, eq=False)
class Job:
    """A task that is about to be planned, from where the arm stands."""

    task: Task
    scene: Scene
    seen: Seen
    estimate: TwoViewEstimate
    followed: IntArray


@dataclass(frozen=True, eq=False)
class Shot:
    """An image and where it was taken."""

    image: ByteArray
    joints: FloatArray
    """(n,) [rad]"""
    matched: MatchedPoints
    """with the goal's image"""


TakeShot: TypeAlias = Callable[[Task, Scene, JointPath], tuple[float, ByteArray, FloatArray]]
"""Leads the arm along a joint path and takes an image at its end: returns how long the move took [s], the
image (height, width) and the joints (n,) [rad] that it was taken in.

Raises:
    ServoStop: the arm was stopped.
"""


class LookingPlanner:
    """Plans a job; where there is no plan and it may look again, it does, and plans from there.

    Args:
        job: as the first image has it.
        take: moves the arm and takes an image.
        goal: with the joints, where the task's scale is odometry.
        seed: of all that is random.
        progress: called with every look.
    """

    def __init__(self, job: Job, take: TakeShot, goal: TaughtGoal, seed: int, progress: Progress) -> None:
        self._take_shot, self._goal, self._seed, self._progress = take, goal, seed, progress
        self._kind = feature_kind_of(job.task)
        self._first = job
        self._standing: ViewingState
        self._shots = [Shot(job.seen.initial_image, job.scene.start_joints, job.seen.matched)]
        self.job = job
        """as it stands after the looks"""
        self.looks: list[TakenLook] = []
        """that were taken"""
        self.seconds = 0.0
        """that they took, wall time"""

    def plan(self) -> tuple[Plan, RiskPlan | None]:
        """Return the plan to follow from where the arm then stands.

        Raises:
            NoSolutionError: there is none; the message says what would have to be better.
            InputError: see `plan_task`.
        """
        self._standing = _standing_of(self.job)
        while True:
            job = self.job
            try:
                plan, risk = plan_task(
                    job.task, job.scene, job.estimate, job.followed, "certified", self._seed
                )
            except (NoPath, InputError) as refused:
                if isinstance(refused, InputError) and not self._standing.reserve_missing:
                    raise
                self._tell(refused)
                begin = perf_counter()
                self._look_on(refused)
                self.seconds += perf_counter() - begin
            else:
                self._tell(risk)
                return plan, risk

    def _look_on(self, refused: NoSolutionError | InputError) -> None:
        """Take the next look.

        Raises:
            NoSolutionError: there is none to take.
        """
        begin, here, most = perf_counter(), self._standing, self._first.task.planning.looks
        if not most or (self.job.task.planning.risk is None and not here.reserve_missing):
            raise refused
        if len(self.looks) >= most:
            raise self._without(refused, f"after {len(self.looks)} more images") from None
        if here.optimum is None and self._kind.name != "tags":
            here = self._standing = replace(here, optimum=self._optimum_of_two())
        chosen: NextLook | str = "the two images do not determine what another would tell"
        if here.optimum is not None or self._kind.name == "tags":
            chosen = next_look(here, self._leads_to_plan, self._seed)
        if isinstance(chosen, str):
            raise self._without(refused, chosen) from None
        if here.optimum is None and not chosen.leads_to_plan:
            raise self._without(refused, "another image tells no more of tags that are known") from None
        self._take(chosen, begin, _refusal(refused), refused)

    def _without(self, refused: NoSolutionError | InputError, why: str) -> NoSolutionError:
        """Return the refusal with what would have to be better."""
        missing = what_is_missing(self._standing, self._leads_to_plan) if self._is_at_risk else ""
        words = f"{refused}; {why}{'; ' if missing else ''}{missing}"
        if isinstance(refused, NoPath):
            refused.args = (words,)
            return refused
        return NoSolutionError(words)

    @property
    def _is_at_risk(self) -> bool:
        return self.job.task.planning.risk is not None

    def _leads_to_plan(self, there: ViewingState) -> bool:
        """Return whether there is a plan from there, at the task's risk if it states one."""
        estimate, task = there.estimate, self.job.task
        if estimate.initial_T_goal is None:
            return False
        pixels, _ = task.camera.project(np.nan_to_num(estimate.points, nan=1.0))
        followed = followed_points(estimate, pixels, shown_at_ends(task, estimate))
        problem, setting = there.problem, there.planned_setting
        if task.planning.risk is None:
            problem = replace(
                problem, points=estimate.points[followed], initial_T_goal=estimate.initial_T_goal
            )
            return plan_with_arm(problem, setting, seed=self._seed).certified
        return plan_arm_with_risk(
            problem, setting, estimate, risk=risk_of_plan(task), points=followed, seed=self._seed,
            mount_covariance=_in_flange(there.mount, setting.flange_T_camera),
        ).ok  # fmt: skip

    def _take(
        self, chosen: NextLook, begin: float, outcome: str, refused: NoSolutionError | InputError
    ) -> None:
        """Move, look, and join what is seen."""
        number, here = len(self.looks) + 1, self._standing
        self._progress("looking again", 0.0)
        before = _known(here.estimate, _risk_of(refused), outcome)
        computing = perf_counter() - begin
        took, image, joints = self._take_shot(self.job.task, self.job.scene, chosen.move.joints)
        begin = perf_counter()
        try:
            self._join(image, joints)
        except NoSolutionError as error:
            raise NoSolutionError(f"{refused}; look {number}: {error}") from None
        move, size = chosen.move, uncertainty_size(here.estimate)
        self.looks.append(
            TakenLook(
                moved_m=float(np.linalg.norm(move.begin_T_end.translation)),
                turned_rad=float(move.begin_T_end.rotation.magnitude()),
                motion_seconds=took,
                computing_seconds=computing + perf_counter() - begin,
                clearance_m=move.clearance.proven,
                expected=chosen.size / size,
                gained=uncertainty_size(self._standing.estimate) / size,
                leads_to_plan=chosen.leads_to_plan,
                before=before,
                after=before,
                image=image,
            )
        )

    def _tell(self, came: NoSolutionError | InputError | RiskPlan | None) -> None:
        """Note what planning came to after the last look."""
        if not self.looks:
            return
        risk = came if isinstance(came, RiskPlan) else _risk_of(came)
        outcome = _refusal(came) if isinstance(came, Exception) else ""
        after = _known(self._standing.estimate, risk, outcome)
        self.looks[-1] = replace(self.looks[-1], after=after)

    def _join(self, image: ByteArray, joints: FloatArray) -> None:
        """Make the job one that begins with this image.

        Raises:
            NoSolutionError: it cannot be matched, or does not agree.
        """
        job, here = self.job, self._standing
        room = here.room_for(here.camera_at(joints))
        task, scene = begun_elsewhere(job.task, job.scene, joints, room)
        try:
            seen = see(self._kind, task.camera, image, self._goal.image)
        except InputError as error:
            raise NoSolutionError(str(error)) from None
        if here.optimum is None:
            estimate = estimate_task(task, scene, seen, self._goal, joints)
            standing = _standing_of(Job(task, scene, seen, estimate, job.followed))
        else:
            joined = [self._matched(image, shot) for shot in self._shots]
            views, points = self._views(seen.matched, joints, joined)
            standing = here.after(joints, views, points)
            standing = replace(
                _standing_of(Job(task, scene, seen, standing.estimate, job.followed)),
                optimum=standing.optimum,
            )
        shown = shown_at_ends(task, standing.estimate)
        followed = followed_points(standing.estimate, seen.matched.initial, shown)
        self.job = Job(task, scene, seen, standing.estimate, followed)
        self._standing = standing
        self._shots.insert(0, Shot(image, joints, seen.matched))

    def _matched(self, image: ByteArray, shot: Shot) -> MatchedPoints | None:
        """Return the points that a new image and an earlier one show; None where they cannot be matched."""
        try:
            return self._kind.match(self._first.task.camera, image, shot.image)
        except (InputError, NoSolutionError):
            return None

    def _views(
        self, matched: MatchedPoints, joints: FloatArray, joined: Sequence[MatchedPoints | None]
    ) -> tuple[ArmViews, FloatArray]:
        """Return all views of the points of the new match, and where those were that were known (n, 3)."""
        n, shots = len(matched), self._shots
        views, points = 2 + len(shots), np.full((n, 3), np.nan)
        pixels, seen = np.zeros((views, n, 2)), np.zeros((views, n), dtype=np.bool_)
        guess = self._standing.estimate.noise_px
        noise = np.full((views, n), guess)
        pixels[0], pixels[GOAL], seen[:2] = matched.initial, matched.goal, True
        if matched.noise is not None:
            noise[:2] = matched.noise.T
        names = np.full((len(shots), n), -1)
        for i, (shot, match) in enumerate(zip(shots, joined, strict=True)):
            if match is None:
                continue
            rows, own = _same(matched.initial, match.initial)
            pixels[2 + i, rows], seen[2 + i, rows] = match.goal[own], True
            if match.noise is not None:
                noise[2 + i, rows] = match.noise[own, 1]
            known, there = _same(match.goal[own], shot.matched.initial)
            names[i, rows[known]] = there
        newest = np.flatnonzero(names[0] >= 0)
        estimate = self._standing.estimate
        of_newest = names[0, newest]
        inliers = estimate.inliers[of_newest]
        points[newest[inliers]] = estimate.points[of_newest[inliers]]
        first = None if joined[-1] is None else names[-1]
        known_errors = self._known_errors(joints, first)
        here, base = self.job.scene, [joints, *(shot.joints for shot in shots)]
        poses = [here.arm.base_T_flange(q) * here.flange_T_camera for q in base]
        reached = chain_of(poses[0], [None, *poses[1:]])
        return ArmViews(
            *_unified(self._first.task, pixels, seen, noise), reached, known_errors,
            is_guess=matched.noise is None, windows=matched.window,
        ), points  # fmt: skip

    def _known_errors(self, joints: FloatArray, first: IntArray | None) -> KnownErrors:
        """Return what is known of mount and scale; ``first`` (n,): each point's row in the first match."""
        scale, scene, mount = self._first.task.scale, self._first.scene, self._standing.mount
        length = None
        if scale.odometry and self._goal.joints is not None:
            here, there = (
                scene.arm.base_T_flange(q) * scene.flange_T_camera for q in (joints, self._goal.joints)
            )
            way = here.inv() * there
            square = float(way.translation @ way.translation)
            slopes = np.eye(6) - adjoint(way.inv())
            by_mount = way.translation @ way.rotation.as_matrix() @ slopes[:3] / square
            length = LengthPrior(float(np.sqrt(square)), scale.sigma, by_mount=by_mount)
        elif scale.displacement is not None and first is not None:
            length = LengthPrior(scale.displacement, scale.sigma, since=1 + len(self._shots))
        elif scale.known_length is not None and first is not None:
            rows = [np.flatnonzero(first == dot) for dot in scale.known_length.dots]
            if all(len(row) for row in rows):
                pair = int(rows[0][0]), int(rows[1][0])
                length = LengthPrior(scale.known_length.length, scale.sigma, rows=pair)
        return KnownErrors(mount, None, length)

    def _optimum_of_two(self) -> ArmViewsOptimum | None:
        """Return how the first two images say what they say, to foretell what another one would."""
        job = self.job
        matched, n = job.seen.matched, len(job.seen.matched)
        noise = np.full((2, n), job.estimate.noise_px) if matched.noise is None else matched.noise.T.copy()
        task, start = job.task, job.scene.start_joints
        scale, length = task.scale, None
        if scale.known_length is not None:
            i, j = scale.known_length.dots
            length = LengthPrior(scale.known_length.length, scale.sigma, rows=(i, j))
        elif scale.displacement is not None:
            length = LengthPrior(scale.displacement, scale.sigma)
        else:
            length = self._known_errors(start, None).length
        pixels, seen = np.stack((matched.initial, matched.goal)), np.ones((2, n), dtype=np.bool_)
        views = ArmViews(
            *_unified(task, pixels, seen, noise), (RigidTransform.identity(), None),
            KnownErrors(self._standing.mount, None, length),
            is_guess=matched.noise is None, windows=matched.window,
        )  # fmt: skip
        return estimate_arm_views(views, job.estimate)[1]


def _unified(
    task: Task, pixels: FloatArray, seen: BoolArray, noise: FloatArray
) -> tuple[UnifiedCamera, FloatArray, BoolArray, FloatArray]:
    """Return camera, pixels (v, n, 2), which are seen, and noise (v, n), in the unified image."""
    image = unified_image(task.camera)
    carried = image.carried(pixels)
    seen = seen & np.isfinite(carried).all(axis=2)
    return image.camera, np.where(seen[..., None], carried, 0.0), seen, noise * image.scale(pixels)


def _standing_of(job: Job) -> ViewingState:
    task, scene, estimate = job.task, job.scene, job.estimate
    if estimate.initial_T_goal is None:
        raise NoSolutionError(f"no goal pose to plan to: {estimate.status}")
    covariance, mount = mount_covariance_of(task), None
    if covariance is not None:
        to_camera = np.eye(6)
        to_camera[:3, :3] = scene.flange_T_camera.rotation.as_matrix().T
        mount = to_camera @ covariance @ to_camera.T
    asked = problem_without_tube(task, estimate.initial_T_goal, estimate.points[estimate.inliers])
    setting = arm_setting_of(task, scene, with_tube=False)
    return ViewingState(asked, setting, tube_of(task), estimate, None, mount)


def _in_flange(mount: FloatArray | None, flange_T_camera: RigidTransform) -> FloatArray | None:
    """Return a mount's covariance in the form of a hand-eye calibration."""
    if mount is None:
        return None
    to_flange = np.eye(6)
    to_flange[:3, :3] = flange_T_camera.rotation.as_matrix()
    return np.asarray(to_flange @ mount @ to_flange.T)


def _same(pixels: FloatArray, others: FloatArray) -> tuple[IntArray, IntArray]:
    """Return rows (k,) of pixels (n, 2) and of others (m, 2) that are the same points of one image."""
    if not len(pixels) or not len(others):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    distances, rows = cKDTree(others).query(pixels)
    same = np.flatnonzero(distances <= JOIN_PX)
    return same, np.asarray(rows)[same]


def _risk_of(refused: object) -> RiskPlan | None:
    return refused.risk if isinstance(refused, NoPath) else None


def _refusal(refused: NoSolutionError | InputError) -> str:
    return refused.plan.reason if isinstance(refused, NoPath) else str(refused)


def _known(estimate: TwoViewEstimate, risk: RiskPlan | None, outcome: str) -> Known:
    place, turn, points = uncertainty_parts(estimate)
    executed = risk is not None and bool(risk.margins)
    return Known(
        place, turn, points, risk.predicted_bound if executed and risk is not None else None, outcome
    )
