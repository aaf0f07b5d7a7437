"""Where several views stand: two of them first, the others by the points that those see."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.estimation.estimate_pose import estimate_pose
from omniservo.estimation.estimate_two_view import estimate_two_view
from omniservo.estimation.known_displacements import DisplacementPrior
from omniservo.estimation.minimal_solvers.triangulation import triangulate_views
from omniservo.estimation.robust.pose_search import PRIOR_NOISE_PX, write_pose_residuals
from omniservo.estimation.two_view_estimate import Status, TwoViewEstimate
from omniservo.estimation.view_points import CheckedPoints
from omniservo.estimation.view_scale import GaugeLength
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.nearest_rotation import nearest_rotation

THRESHOLD_PX = 3.0
"""Distance at which a pixel stops to count while a point is placed; in σ·6 where the noise is stated."""

LEAST_THRESHOLD_PX = 1.0
"""The first poses err more than pixels do; what is wrong by less is found when all are adjusted."""

MOST_PAIRS = 15
TRIED_PAIRS = 3
POINTS_NOISE = 2.0
"""by which residuals of points that are not adjusted yet exceed the noise of their pixels"""

LEAST_POINTS = 4
"""of which a view's pose is found"""

ENOUGH_PARALLAX = 0.2
"""[rad] More does not make a pair more promising."""

LEAST_PARALLAX = 1e-3
"""[rad] is taken where less is seen, so that many points count before few"""


@dataclass(eq=False)
class PlacedViews:
    """Points of several views, and the poses and places found so far; grows by `place`."""

    camera: UnifiedCamera
    given: CheckedPoints
    room_px: float
    """what the camera's parameters may be off at a pixel, root mean square [px]"""
    poses: FloatArray
    """(v, 7) quaternion, translation of reference_T_camera"""
    placed: BoolArray
    """(v,) which views have a pose"""
    points: FloatArray
    """(n, 3), NaN where a point has no place"""
    agree: BoolArray
    """(v, n) which pixels agree with the points"""
    failed: dict[int, str] = field(default_factory=dict)
    """why views have no pose"""
    shown_px: float = 0.0
    """σ that the residuals of pairs of views show, where none is stated [px]"""

    @classmethod
    def of(cls, camera: UnifiedCamera, given: CheckedPoints, room_px: float) -> PlacedViews:
        """Return views of which nothing is placed yet."""
        v, n = given.seen.shape
        poses = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (v, 1))
        points, agree = np.full((n, 3), np.nan), np.zeros((v, n), dtype=np.bool_)
        return cls(camera, given, room_px, poses, np.zeros(v, dtype=np.bool_), points, agree)

    @property
    def pixels(self) -> FloatArray:
        """Places (v, n, 2) [px]."""
        return self.given.pixels

    @property
    def seen(self) -> BoolArray:
        """Which of them are (v, n)."""
        return self.given.seen

    def noise(self, room_px: float = 0.0) -> FloatArray | None:
        """Return σ (v, n) [px] of pixels, the camera's model error and so much room added; None: unknown."""
        if self.given.noise is None:
            return None
        error = 0.0 if self.camera.model_error is None else self.camera.model_error.sigma_px
        return np.hypot(self.given.noise, np.hypot(error, room_px))

    def triangulate(self) -> None:
        """Place the points by the views that have a pose."""
        self._triangulate(self.points, self.agree)

    def regain(self) -> None:
        """Place the points that have none, by the views as they stand now."""
        points, agree = np.empty_like(self.points), np.empty_like(self.agree)
        self._triangulate(points, agree)
        lost = np.isnan(self.points[:, 0])
        self.points[lost] = points[lost]

    def _triangulate(self, points: FloatArray, agree: BoolArray) -> None:
        sigma, threshold = self.noise(self.room_px), max(THRESHOLD_PX, 6.0 * self.shown_px)
        if sigma is not None and self.seen.any():
            threshold = max(LEAST_THRESHOLD_PX, 6.0 * float(np.quantile(sigma[self.seen], 0.9)))
        triangulate_views(
            self.camera.parameters,
            self.pixels,
            self.given.bearings,
            self.seen & self.placed[:, None],
            self.poses,
            threshold,
            points,
            agree,
        )

    def place(self, view: int, points: FloatArray, rows: npt.NDArray[Any]) -> str:
        """Give a view the pose that these points have in it; return why not, or nothing."""
        # The points err more than the pixels, so the noise of pixels is not that of these residuals; but
        # where it is more than is usual, they would be taken for wrong without it.
        stated = self.given.noise
        noise = np.full(len(points), self.shown_px) if stated is None else stated[view, rows]
        found = estimate_pose(
            self.camera, points, self.pixels[view, rows],
            noise=POINTS_NOISE * noise if float(np.median(noise)) > PRIOR_NOISE_PX else None,
        )  # fmt: skip
        if found.status != "ok":
            return found.message
        self.poses[view] = found.minima[0]
        self.placed[view] = True
        return ""


def place_all(views: PlacedViews, robust: bool) -> tuple[Status, str]:
    """Place the views from two of them; return "ok", or what came of the pairs.

    The pairs that tell most of the structure are tried until one of them places all views; else the one on
    which most pixels agree is taken.
    """
    status, words, pairs = motions_of_pairs(views, robust, 0.0)
    if not pairs and views.room_px > 0.0:  # the camera's parameters alone may make good matches disagree
        status, words, pairs = motions_of_pairs(views, robust, views.room_px)
    best: tuple[int, FloatArray, BoolArray, dict[int, str]] | None = None
    for first, second, motion in pairs[:TRIED_PAIRS]:
        views.placed[:] = False
        views.placed[[first, second]] = True
        views.poses[first] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        views.poses[second, :4], views.poses[second, 4:] = motion.rotation.as_quat(), motion.translation
        place_others(views)
        agreeing = int(views.agree.sum())
        if best is None or agreeing > best[0]:
            best = agreeing, views.poses.copy(), views.placed.copy(), dict(views.failed)
        if not views.failed:
            break
    if best is None:
        return status, words
    views.poses[:], views.placed[:], views.failed = best[1], best[2], best[3]
    views.triangulate()
    return "ok", ""


def place_by_displacements(views: PlacedViews, prior: DisplacementPrior) -> bool:
    """Place the views that displacements link, and by the points the others; tell whether rays meet."""
    lengths = [
        float(np.linalg.norm(move.translation))
        / max(float(np.sqrt(np.trace(prior.covariance[6 * k : 6 * k + 3, 6 * k : 6 * k + 3]))), 1e-300)
        for k, move in enumerate(prior.moves)
    ]
    first = prior.pairs[int(np.argmax(lengths)), 0]
    views.placed[:], views.failed = False, {}
    views.placed[first] = True
    views.poses[first] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    place_linked(views, prior)
    place_others(views)
    return bool(views.agree.any())


def place_linked(views: PlacedViews, prior: DisplacementPrior) -> list[int]:
    """Place, by known displacements alone, the views that have no pose; return which."""
    linked: list[int] = []
    while True:
        for view in np.flatnonzero(~views.placed):
            pose = prior.pose_of(int(view), views.poses, views.placed)
            if pose is not None:
                views.poses[view], views.placed[view] = pose, True
                views.failed.pop(int(view), None)
                linked.append(int(view))
                break
        else:
            return linked


def motions_of_pairs(
    views: PlacedViews, robust: bool, room_px: float
) -> tuple[Status, str, list[tuple[int, int, RigidTransform]]]:
    """Return the motions of pairs of views, that which tells most of the structure first.

    Without any: the status of the most promising pair, and its evidence.
    """
    promise = {pair: _promise(views, *pair) for pair in combinations(range(len(views.seen)), 2)}
    pairs = sorted((pair for pair in promise if promise[pair] > 0.0), key=lambda pair: -promise[pair])
    pairs, noise = pairs[:MOST_PAIRS], views.noise(room_px)
    motions: list[tuple[float, int, int, RigidTransform]] = []
    refused: list[tuple[Status, str]] = []
    shown: list[float] = []
    for a, b in pairs:
        both = views.seen[a] & views.seen[b]
        sigma = None if noise is None else np.stack((noise[a, both], noise[b, both]), axis=1)
        camera = views.camera
        found = estimate_two_view(
            camera, views.pixels[a, both], views.pixels[b, both], robust=robust, noise=sigma
        )
        if found.initial_T_goal is not None:
            motions.append((_information(found), a, b, found.initial_T_goal))
            shown.append(found.noise_px)
        else:
            refused.append((found.status, f"views {a} and {b}: {found.message}"))
    views.shown_px = float(np.median(shown)) if shown and noise is None else 0.0
    flat = [(status, words) for status, words in refused if status == "planar_points"]
    if 2 * len(flat) > len(pairs):  # of many pairs, chance lets one pass for more than a plane
        return *flat[0], []
    first = refused[0] if refused else ("too_few_points", "no two views share a point")
    return *first, [motion[1:] for motion in sorted(motions, key=lambda motion: -motion[0])]


def _promise(views: PlacedViews, a: int, b: int) -> float:
    """Return how many points two views share, times the parallax that no rotation takes away [rad]."""
    both = views.seen[a] & views.seen[b]
    if both.sum() < LEAST_POINTS:
        return float(both.sum()) * LEAST_PARALLAX * LEAST_PARALLAX
    first, second = views.given.bearings[a, both], views.given.bearings[b, both]
    near = np.ones(len(first), dtype=np.bool_)
    for _ in range(3):  # wrong matches are the farthest ones
        turn = nearest_rotation(first[near].T @ second[near])
        apart = np.linalg.norm(first - second @ turn.T, axis=1)
        near = apart <= 3.0 * np.median(apart)
    parallax = min(max(float(np.median(apart)), LEAST_PARALLAX), ENOUGH_PARALLAX)
    return float(both.sum()) * parallax


def _information(found: TwoViewEstimate) -> float:
    """Return Σ distance²/variance over the points: how well, and of how many, the structure is known."""
    points = found.points[found.inliers]
    variance = np.trace(found.points_covariance[found.inliers], axis1=1, axis2=2)
    return float(((points**2).sum(axis=1) / np.maximum(variance, 1e-300)).sum())


def place_others(views: PlacedViews) -> None:
    """Place every other view by the points that have a place; ``failed`` says why not."""
    failed: dict[int, str] = {}
    while True:
        views.triangulate()
        known = ~np.isnan(views.points[:, 0])
        counts = (views.seen & known).sum(axis=1)
        waiting = [v for v in range(len(counts)) if not views.placed[v] and v not in failed]
        if not waiting:
            break
        view = max(waiting, key=lambda v: int(counts[v]))
        rows = views.seen[view] & known
        words = f"only {rows.sum()} of its points have a place"
        if rows.sum() >= LEAST_POINTS:
            words = views.place(view, views.points[rows], rows)
        if words:
            failed[view] = words
        else:  # what could not be placed may be so now
            failed.clear()
    views.failed = failed


def pose_of(row: FloatArray) -> RigidTransform:
    """Return a row of ``poses`` as a pose."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(row[:4]).as_matrix(), row[4:]
    return RigidTransform(matrix, normalize=False)


def place_by_known_points(views: PlacedViews, length: GaugeLength) -> bool:
    """Place the views in which the known points tell the pose; True where at least two do."""
    if len(length.known) < LEAST_POINTS or not length.is_one_frame:
        return False
    for view in range(len(views.seen)):
        rows = views.seen[view, length.indices]
        if rows.sum() >= LEAST_POINTS:
            views.place(view, length.known[rows], length.indices[rows])
    if views.placed.sum() >= 2:
        return True
    views.placed[:] = False
    return False


def residuals_of(views: PlacedViews) -> FloatArray:
    """Return projection minus pixel (v, n, 2) [px], NaN where there is no pose, place or pixel."""
    residuals = np.full(views.pixels.shape, np.nan)
    for view in np.flatnonzero(views.placed):
        write_pose_residuals(
            views.camera.parameters,
            views.points,
            views.pixels[view],
            views.poses[view, :4],
            views.poses[view, 4:],
            residuals[view],
        )
    residuals[~views.seen] = np.nan
    return residuals
