"""Where there is no plan: the arm moves a little, takes an image, and it is planned again with both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, NoSolutionError
from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.looks import (
    CertifiedMove,
    NextLook,
    ViewingState,
    next_look,
    uncertainty_parts,
    uncertainty_size,
    what_is_missing,
)
from omniservo.perception import MatchedPoints
from omniservo.planning import Plan
from omniservo.results import Known, TakenLook
from omniservo.risk import RiskPlan, plan_arm_with_risk
from omniservo.robots import JointPath
from omniservo.robots.path_following.joint_segment import joint_segment
from omniservo.runs.arm_setting_of import arm_setting_of, tube_of
from omniservo.runs.begun_elsewhere import begun_elsewhere
from omniservo.runs.estimate_task import estimate_task
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.followed_of import followed_of
from omniservo.runs.job_progress import Progress
from omniservo.runs.joined_views import Job, Joining, Shot
from omniservo.runs.no_path import NoPath
from omniservo.runs.plan_task import mount_covariance_of, plan_task, problem_without_tube, risk_of_plan
from omniservo.runs.see import see
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal
from omniservo.whole_arm import plan_with_arm

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
        self._first, self._joining = job, Joining(job, goal)
        self._standing: ViewingState
        self._shots = [Shot(job.seen.initial_image, job.scene.start_joints, job.seen.matched)]
        self._failed: list[CertifiedMove] = []
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
                while not self._look_on(refused):
                    pass
                self.seconds += perf_counter() - begin
            else:
                self._tell(risk)
                return plan, risk

    def _look_on(self, refused: NoSolutionError | InputError) -> bool:
        """Take the next look, and return whether its image was joined.

        Raises:
            NoSolutionError: there is none to take.
        """
        begin, here, most = perf_counter(), self._standing, self._first.task.planning.looks
        if not most or (self.job.task.planning.risk is None and not here.reserve_missing):
            raise refused
        if len(self.looks) >= most:
            raise self._without(
                refused, f"after {len(self.looks)} more image{'s' if len(self.looks) > 1 else ''}"
            ) from None
        if here.optimum is None and self._kind.name != "tags":
            here = self._standing = replace(here, optimum=self._joining.optimum_of_two(here, self._shots[0]))
        chosen: NextLook | str = "the two images do not determine what another would tell"
        if here.optimum is not None or self._kind.name == "tags":
            chosen = next_look(here, self._leads_to_plan, self._seed, self._failed)
        if isinstance(chosen, str):
            raise self._without(refused, chosen) from None
        if here.optimum is None and not chosen.leads_to_plan:
            raise self._without(refused, "another image tells no more of tags that are known") from None
        return self._take(chosen, begin, refused)

    def _without(self, refused: NoSolutionError | InputError, why: str) -> NoSolutionError:
        """Return the refusal with what would have to be better."""
        missing = what_is_missing(self._standing, self._leads_to_plan) if self._is_at_risk else ""
        failed = [f"look {i}: {look.nothing}" for i, look in enumerate(self.looks, start=1) if look.nothing]
        words = "; ".join(filter(None, [str(refused), *failed, why, missing]))
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
        problem, setting, followed = there.problem, there.planned_setting, there.planned_rows
        if task.planning.risk is None:
            problem = replace(problem, initial_T_goal=estimate.initial_T_goal)
            return plan_with_arm(problem, setting, seed=self._seed).certified
        return plan_arm_with_risk(
            problem, setting, estimate, risk=risk_of_plan(task), points=followed, seed=self._seed,
            mount_covariance=_in_flange(there.mount, setting.flange_T_camera),
        ).ok  # fmt: skip

    def _take(self, chosen: NextLook, begin: float, refused: NoSolutionError | InputError) -> bool:
        """Move, look, and join what is seen; return whether that can be. If not, the arm goes back."""
        here, move, nothing = self._standing, chosen.move, ""
        self._progress("looking again", 0.0)
        before = _known(here.estimate, _risk_of(refused), _refusal(refused))
        size = uncertainty_size(here.estimate)
        computing = perf_counter() - begin
        scene = self.job.scene
        took, image, joints = self._take_shot(self.job.task, scene, move.joints)
        begin = perf_counter()
        try:
            self._join(image, joints)
        except NoSolutionError as error:
            nothing = str(error)
        computing += perf_counter() - begin
        if nothing:
            # the same line from its end: it is proven as a whole, whichever way it is followed
            line = move.joints.positions
            back = joint_segment(scene.arm, line[-1], line[0], scene.flange_T_camera)
            took += self._take_shot(self.job.task, scene, back)[0]
            self._failed.append(move)
        else:
            self._failed.clear()
        self.looks.append(
            TakenLook(
                moved_m=float(np.linalg.norm(move.begin_T_end.translation)),
                turned_rad=float(move.begin_T_end.rotation.magnitude()),
                motion_seconds=took,
                computing_seconds=computing,
                clearance_m=move.clearance.proven,
                expected=chosen.size / size,
                gained=uncertainty_size(self._standing.estimate) / size,
                leads_to_plan=chosen.leads_to_plan,
                before=before,
                after=before,
                image=image,
                nothing=nothing,
            )
        )
        return not nothing

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
            views, points = self._joining.views(here, self._shots, Shot(image, joints, seen.matched), joined)
            standing = here.after(joints, views, points)
            standing = replace(
                _standing_of(Job(task, scene, seen, standing.estimate, job.followed)),
                optimum=standing.optimum,
            )
        followed = followed_of(task, standing.estimate, seen.matched.initial)
        self.job = Job(task, scene, seen, standing.estimate, followed)
        self._standing = standing
        self._shots.insert(0, Shot(image, joints, seen.matched))

    def _matched(self, image: ByteArray, shot: Shot) -> MatchedPoints | None:
        """Return the points that a new image and an earlier one show; None where they cannot be matched."""
        try:
            return self._kind.match(self._first.task.camera, image, shot.image)
        except (InputError, NoSolutionError):
            return None


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
