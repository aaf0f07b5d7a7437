"""The images of a job so far as views that the arm has reached, of points that are the same in all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import unified_image
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
from omniservo.looks import ViewingState
from omniservo.looks.followed_points import spread_rows
from omniservo.perception import MatchedPoints
from omniservo.results import Seen
from omniservo.runs.estimate_task import known_dots
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal

JOIN_PX = 0.25
"""Points of two matches are one where they lie as near to each other in the image that both have."""

MOST_JOINED = 150
"""Points that are joined over all images, of those the best known, spread over the image: all weigh on all,
and more make smaller only what pixels err, not what mount, lens and scale do"""


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


@dataclass(frozen=True, eq=False)
class Joining:
    """How the images of a job are joined."""

    first: Job
    """as the first image has it"""
    goal: TaughtGoal
    """with the joints, where the task's scale is odometry"""

    def views(
        self, here: ViewingState, shots: Sequence[Shot], new: Shot, joined: Sequence[MatchedPoints | None]
    ) -> tuple[ArmViews, FloatArray]:
        """Return all views of the points of the new match, and where those were that were known (n, 3).

        Args:
            here: what was known before.
            shots: those before, the newest first.
            new: one more.
            joined: what it and each of those before show both; None: that could not be matched.
        """
        matched, n, estimate = new.matched, len(new.matched), here.estimate
        views, points = 2 + len(shots), np.full((n, 3), np.nan)
        pixels, seen = np.zeros((views, n, 2)), np.zeros((views, n), dtype=np.bool_)
        noise = np.full((views, n), estimate.noise_px)
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
        newest = newest[estimate.inliers[names[0, newest]]]
        complete = newest[seen[:, newest].all(axis=0)]
        newest = complete if len(complete) >= MOST_JOINED else newest
        before = self._joined_rows(estimate, shots[0], names[0, newest])
        newest = newest[np.isin(names[0, newest], before)]
        points[newest] = estimate.points[names[0, newest]]
        first = None if joined[-1] is None else names[-1]
        scene, known_errors = self.first.scene, self._known_errors(here, new.joints, first, 1 + len(shots))
        base = [new.joints, *(shot.joints for shot in shots)]
        poses = [scene.arm.base_T_flange(q) * scene.flange_T_camera for q in base]
        reached = chain_of(poses[0], [None, *poses[1:]])
        return ArmViews(
            *_unified(self.first.task, pixels, seen, noise), reached, known_errors,
            is_guess=matched.noise is None, windows=matched.window,
        ), points  # fmt: skip

    @cached_property
    def _known_dots(self) -> tuple[int, int]:
        """Rows of the first match between which the length is known."""
        return known_dots(self.first.task, self.first.seen)

    def _joined_rows(self, estimate: TwoViewEstimate, shot: Shot, rows: IntArray) -> IntArray:
        """Return `MOST_JOINED` of the rows of a shot's match; all of dots, two of which are a length."""
        if self.first.task.scale.known_length is not None:
            return rows
        return spread_rows(estimate, shot.matched.initial, rows, MOST_JOINED)

    def _known_errors(
        self, here: ViewingState, joints: FloatArray, first: IntArray | None, since: int
    ) -> KnownErrors:
        """Return what is known of mount and scale.

        ``first`` (n,): each point's row in the first match; ``since``: the number of that match's view.
        """
        scale, scene = self.first.task.scale, self.first.scene
        length = None
        if scale.odometry and self.goal.joints is not None:
            now, there = (
                scene.arm.base_T_flange(q) * scene.flange_T_camera for q in (joints, self.goal.joints)
            )
            way = now.inv() * there
            square = float(way.translation @ way.translation)
            slopes = np.eye(6) - adjoint(way.inv())
            by_mount = way.translation @ way.rotation.as_matrix() @ slopes[:3] / square
            length = LengthPrior(float(np.sqrt(square)), scale.sigma, by_mount=by_mount)
        elif scale.displacement is not None and first is not None:
            length = LengthPrior(scale.displacement, scale.sigma, since=since)
        elif scale.known_length is not None and first is not None:
            rows = [np.flatnonzero(first == row) for row in self._known_dots]
            if all(len(row) for row in rows):
                pair = int(rows[0][0]), int(rows[1][0])
                length = LengthPrior(scale.known_length.length, scale.sigma, rows=pair)
        return KnownErrors(here.mount, _lens_of(self.first.task), length)

    def optimum_of_two(self, here: ViewingState, shot: Shot) -> ArmViewsOptimum | None:
        """Return how the first shot and the goal's image tell what they do, to foretell what more tell."""
        matched, n, estimate = shot.matched, len(shot.matched), here.estimate
        noise = np.full((2, n), estimate.noise_px) if matched.noise is None else matched.noise.T.copy()
        scale, length = self.first.task.scale, None
        if scale.known_length is not None:
            length = LengthPrior(scale.known_length.length, scale.sigma, rows=self._known_dots)
        elif scale.displacement is not None:
            length = LengthPrior(scale.displacement, scale.sigma)
        else:
            length = self._known_errors(here, shot.joints, None, 0).length
        pixels, seen = np.stack((matched.initial, matched.goal)), np.ones((2, n), dtype=np.bool_)
        views = ArmViews(
            *_unified(self.first.task, pixels, seen, noise), (RigidTransform.identity(), None),
            KnownErrors(here.mount, _lens_of(self.first.task), length),
            is_guess=matched.noise is None, windows=matched.window,
        )  # fmt: skip
        inliers = np.zeros(n, dtype=np.bool_)
        inliers[self._joined_rows(estimate, shot, np.flatnonzero(estimate.inliers))] = True
        return estimate_arm_views(views, replace(estimate, inliers=inliers))[1]


def _lens_of(task: Task) -> FloatArray | None:
    """Return the covariance of the camera's parameters, if it states one."""
    stated = unified_image(task.camera).camera.calibration_covariance
    return None if stated is None else np.array(stated)


def _unified(
    task: Task, pixels: FloatArray, seen: BoolArray, noise: FloatArray
) -> tuple[UnifiedCamera, FloatArray, BoolArray, FloatArray]:
    """Return camera, pixels (v, n, 2), which are seen, and noise (v, n), in the unified image."""
    image = unified_image(task.camera)
    carried = image.carried(pixels)
    seen = seen & np.isfinite(carried).all(axis=2)
    return image.camera, np.where(seen[..., None], carried, 0.0), seen, noise * image.scale(pixels)


def _same(pixels: FloatArray, others: FloatArray) -> tuple[IntArray, IntArray]:
    """Return rows (k,) of pixels (n, 2) and of others (m, 2) that are the same points of one image."""
    if not len(pixels) or not len(others):
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    distances, rows = cKDTree(others).query(pixels)
    same = np.flatnonzero(distances <= JOIN_PX)
    return same, np.asarray(rows)[same]
