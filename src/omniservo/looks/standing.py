"""Where an arm stands before its target, what is known there, and what would be elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, NoSolutionError
from omniservo.estimation import JointUncertainty, TwoViewEstimate
from omniservo.estimation.arm_views import GOAL, ArmViews, ArmViewsOptimum, with_view
from omniservo.estimation.estimate_arm_views import estimate_arm_views, estimate_at
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.looks.certified_move import CertifiedMove, mount_room
from omniservo.looks.followed_points import followed_points, shown_at_ends
from omniservo.planning import PlanningProblem, widened_evenly
from omniservo.replanning.frame_change import problem_from
from omniservo.robots import Tube
from omniservo.short_repr import short_repr
from omniservo.whole_arm import ArmSetting
from omniservo.whole_arm.arm_ends import violation_at_start


@with_field_docs
@dataclass(frozen=True, eq=False)
class ViewingState:
    """An arm before its target; everything in the frame of its camera there."""

    asked: PlanningProblem
    """what to keep, without what a tube takes; its points and goal do not count"""
    setting: ArmSetting
    """the arm as it stands, without a tube"""
    tube: Tube | None
    """of paths that are led by the image"""
    estimate: TwoViewEstimate
    """what all images so far say"""
    optimum: ArmViewsOptimum | None = None
    """how they say it; None: of a target of known geometry, of which another image tells no more"""
    mount: FloatArray | None = None
    """(6, 6) covariance of the mount's error in the camera's frame; None: exact"""

    __repr__ = short_repr

    @property
    def problem(self) -> PlanningProblem:
        """What a plan from here has to keep, its tube included, with the camera as it was found.

        Raises:
            InputError: nothing is left of the image or of the workspace.
        """
        return self._asked_of(self.estimate.points[self.planned_rows])

    @property
    def planned_rows(self) -> IntArray:
        """(m,) the estimate's points that a plan from here follows.

        Raises:
            InputError: nothing is left of the image or of the workspace.
        """
        estimate = self.estimate
        problem = self._asked_of(estimate.points[estimate.inliers])
        pixels, _ = problem.camera.project(np.nan_to_num(estimate.points, nan=1.0))
        return followed_points(estimate, pixels, shown_at_ends(problem, estimate))

    @property
    def planned_setting(self) -> ArmSetting:
        """The arm with its tube, or with what joints keep without one for visual servoing.

        Raises:
            InputError: a joint stands nearer to the end of its range than that.
        """
        return replace(self.setting, tube=self.tube).servoed

    @property
    def start(self) -> FloatArray:
        """(n,) where the arm stands [rad].

        Raises:
            InputError: the setting does not say.
        """
        if self.setting.start is None:
            raise InputError("setting.start: None given; where the arm stands is needed")
        return self.setting.start

    @property
    def singular_value(self) -> float:
        """The smallest that a plan keeps."""
        own = self.setting.singular_value
        return own if self.tube is None else max(own, self.tube.singular_value)

    @property
    def reserve_missing(self) -> str:
        """What the start lacks of singular value or joint-limit margin that a plan keeps; "": nothing."""
        try:
            setting = self.planned_setting
        except InputError as error:
            return str(error)
        jacobian = setting.arm.scaled_camera_jacobian(self.start, setting.flange_T_camera)
        least = float(np.linalg.svd(jacobian, compute_uv=False)[-1])
        if least >= setting.singular_value:
            return ""
        return (
            f"the arm is singular: smallest singular value {least:.4f}; at least "
            f"{setting.singular_value:g} is needed"
        )

    @property
    def is_free(self) -> bool:
        """Whether the arm can stand here with all that a plan keeps."""
        try:
            problem, setting = self.problem, self.planned_setting
            return not violation_at_start(problem, setting, setting.bodies(problem.obstacles))
        except InputError:
            return False

    def expected_after(self, move: CertifiedMove) -> ViewingState | None:
        """Return where a move leads and what is expected to be known; None: too few points are seen there."""
        there = self._moved(move.begin_T_end, move.joints.positions[-1])
        if self.optimum is None:
            return replace(there, estimate=seen_from(self.estimate, move.begin_T_end.inv()))
        optimum = with_view(self.optimum, move.begin_T_end)
        estimate = estimate_at(optimum)
        return None if estimate is None else replace(there, estimate=estimate, optimum=optimum)

    def after(self, joints: FloatArray, views: ArmViews, points: FloatArray) -> ViewingState:
        """Return where the arm stands after a move, and what the images say, those from before included.

        Args:
            joints: (n,) as they are read there [rad].
            views: the first is that from there; the displacements are those of the joints.
            points: (m, 3) of its points in the frame before the move, NaN where not known [m].

        Raises:
            NoSolutionError: the images do not agree with each other.
        """
        pose = self.camera_at(joints)
        known = np.isfinite(points).all(axis=1) & views.seen[0] & views.seen[GOAL]
        goal, back = self.estimate.initial_T_goal, pose.inv()
        start = replace(
            self.estimate,
            initial_T_goal=None if goal is None else back * goal,
            points=back.apply(points),
            inliers=known,
        )
        estimate, optimum = estimate_arm_views(views, start)
        if optimum is None:
            raise NoSolutionError(f"{estimate.status}: {estimate.message}")
        return replace(self._moved(pose, joints), estimate=estimate, optimum=optimum)

    def camera_at(self, joints: FloatArray) -> RigidTransform:
        """Return the camera's pose at joints (n,) in its frame of now, as the arm has it."""
        flange = self.setting.arm.base_T_flange(joints)
        return self.setting.base_T_initial.inv() * flange * self.setting.flange_T_camera

    def room_for(self, pose: RigidTransform) -> float:
        """Return how far things that are known in the camera's frame of now may be from there [m].

        They stand where the joints have them in the frame at ``pose``, as exactly as the mount is known: for
        what is no farther from the camera than the farthest inlier. What the arm passes farther away may be
        more off.
        """
        inliers = self.estimate.points[self.estimate.inliers]
        return mount_room(pose, self.mount, float(np.linalg.norm(inliers, axis=1).max()))

    def _asked_of(self, points: FloatArray) -> PlanningProblem:
        camera = self.asked.camera if self.optimum is None else self.optimum.camera
        asked = replace(self.asked, camera=camera, points=points)
        return asked if self.tube is None else widened_evenly(asked, self.tube.position, self.tube.image)

    def _moved(self, pose: RigidTransform, joints: FloatArray) -> ViewingState:
        """Return the same elsewhere; clearances have room for what the mount makes of obstacles' places."""
        asked, off = problem_from(self.asked, pose, 0.0, None), self.room_for(pose)
        if asked.obstacles or asked.workspace is not None:
            asked = widened_evenly(asked, off, 0.0)
        clearance = None if self.setting.clearance is None else self.setting.clearance + off
        setting = replace(
            self.setting, start=joints, base_T_initial=self.setting.base_T_initial * pose, clearance=clearance
        )
        return replace(self, asked=asked, setting=setting)


def seen_from(estimate: TwoViewEstimate, next_T_first: RigidTransform) -> TwoViewEstimate:
    """Return an estimate in another frame, which is known exactly in that of the first view."""
    law, turn = estimate.uncertainty, next_T_first.rotation.as_matrix()
    pose = estimate.initial_T_goal
    whole = np.eye(6)
    whole[:3, :3] = turn
    return replace(
        estimate,
        initial_T_goal=None if pose is None else next_T_first * pose,
        points=next_T_first.apply(estimate.points),
        covariance=whole @ estimate.covariance @ whole.T,
        points_covariance=turn @ estimate.points_covariance @ turn.T,
        uncertainty=None if law is None else _turned(law, turn),
    )


def _turned(law: JointUncertainty, turn: FloatArray) -> JointUncertainty:
    def rows(given: FloatArray) -> FloatArray:
        parts = given.reshape(len(given), given.shape[1] // 3, 3) @ turn.T
        parts[:, 1] = given[:, 3:6]  # the goal's rotation vector stands in the goal's own frame
        return parts.reshape(given.shape)

    return replace(
        law,
        noise=rows(law.noise),
        own=turn @ law.own @ turn.T,
        calibration=rows(law.calibration),
        pixel_sigma=None,
    )
