"""Where several views stand: two of them first, the others by the points that those see."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.estimation.estimate_pose import estimate_pose
from omniservo.estimation.estimate_two_view import estimate_two_view
from omniservo.estimation.minimal_solvers.triangulation import triangulate_views
from omniservo.estimation.two_view_estimate import Status, TwoViewEstimate
from omniservo.geometry.arrays import BoolArray, FloatArray

THRESHOLD_PX = 3.0
"""Distance at which a pixel stops to count while a point is placed; in σ·6 where the noise is stated."""

MOST_PAIRS = 15
TRIED_PAIRS = 3
LEAST_POINTS = 4
"""of which a view's pose is found"""


@dataclass(eq=False)
class PlacedViews:
    """Pixels of several views, and the poses and points found so far; grows by `place`."""

    camera: UnifiedCamera
    pixels: FloatArray
    """(v, n, 2)"""
    bearings: FloatArray
    """(v, n, 3)"""
    seen: BoolArray
    """(v, n)"""
    noise: float | None
    """σ of a pixel coordinate [px], where it is stated"""
    poses: FloatArray
    """(v, 7) quaternion, translation of reference_T_camera"""
    placed: BoolArray
    """(v,) which views have a pose"""
    points: FloatArray
    """(n, 3), NaN where a point has no place"""
    agree: BoolArray
    """(v, n) which pixels agree with the points"""

    def triangulate(self) -> None:
        """Place the points by the views that have a pose."""
        threshold = THRESHOLD_PX if self.noise is None else 6.0 * self.noise
        triangulate_views(
            self.camera.parameters,
            self.pixels,
            self.bearings,
            self.seen & self.placed[:, None],
            self.poses,
            threshold,
            self.points,
            self.agree,
        )

    def place(self, view: int, points: FloatArray, rows: npt.NDArray[Any]) -> str:
        """Give a view the pose that these points have in it; return why not, or nothing."""
        # The points err more than the pixels, so the noise that is stated is not that of these residuals.
        found = estimate_pose(self.camera, points, self.pixels[view, rows])
        if found.status != "ok":
            return found.message
        self.poses[view] = found.minima[0]
        self.placed[view] = True
        return ""


def place_all(views: PlacedViews, robust: bool) -> tuple[Status, str, dict[int, str]]:
    """Place the views from two of them; return "ok" or what came of the pairs, and why others have no place.

    The pairs that tell most of the structure are tried until one of them places all views; else the one on
    which most pixels agree is taken.
    """
    status, words, pairs = motions_of_pairs(views, robust)
    best: tuple[int, FloatArray, BoolArray, dict[int, str]] | None = None
    for first, second, motion in pairs[:TRIED_PAIRS]:
        views.placed[:] = False
        views.placed[[first, second]] = True
        views.poses[first] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        views.poses[second, :4], views.poses[second, 4:] = motion.rotation.as_quat(), motion.translation
        failed = place_others(views)
        agreeing = int(views.agree.sum())
        if best is None or agreeing > best[0]:
            best = agreeing, views.poses.copy(), views.placed.copy(), failed
        if not failed:
            break
    if best is None:
        return status, words, {}
    views.poses[:], views.placed[:] = best[1], best[2]
    views.triangulate()
    return "ok", "", best[3]


def motions_of_pairs(
    views: PlacedViews, robust: bool
) -> tuple[Status, str, list[tuple[int, int, RigidTransform]]]:
    """Return the motions of pairs of views, that which tells most of the structure first.

    Without any: the status of the pair that shares most points, and its evidence.
    """
    shared = {
        pair: int((views.seen[pair[0]] & views.seen[pair[1]]).sum())
        for pair in combinations(range(len(views.seen)), 2)
    }
    pairs = sorted((pair for pair in shared if shared[pair]), key=lambda pair: -shared[pair])[:MOST_PAIRS]
    motions: list[tuple[float, int, int, RigidTransform]] = []
    refused: list[tuple[Status, str]] = []
    for a, b in pairs:
        both = views.seen[a] & views.seen[b]
        found = estimate_two_view(
            views.camera, views.pixels[a, both], views.pixels[b, both], robust=robust, noise=views.noise
        )
        if found.initial_T_goal is not None:
            motions.append((_information(found), a, b, found.initial_T_goal))
        else:
            refused.append((found.status, f"views {a} and {b}: {found.message}"))
    flat = [(status, words) for status, words in refused if status == "planar_points"]
    if 2 * len(flat) > len(pairs):  # of many pairs, chance lets one pass for more than a plane
        return *flat[0], []
    first = refused[0] if refused else ("too_few_points", "no two views share a point")
    return *first, [motion[1:] for motion in sorted(motions, key=lambda motion: -motion[0])]


def _information(found: TwoViewEstimate) -> float:
    """Return Σ distance²/variance over the points: how well, and of how many, the structure is known."""
    points = found.points[found.inliers]
    variance = np.trace(found.points_covariance[found.inliers], axis1=1, axis2=2)
    return float(((points**2).sum(axis=1) / np.maximum(variance, 1e-300)).sum())


def place_others(views: PlacedViews) -> dict[int, str]:
    """Place every other view by the points that have a place; return why not, by view."""
    failed: dict[int, str] = {}
    while True:
        views.triangulate()
        known = ~np.isnan(views.points[:, 0])
        counts = (views.seen & known).sum(axis=1)
        waiting = [v for v in range(len(counts)) if not views.placed[v] and v not in failed]
        if not waiting:
            return failed
        view = max(waiting, key=lambda v: int(counts[v]))
        rows = views.seen[view] & known
        words = f"only {rows.sum()} of its points have a place"
        if rows.sum() >= LEAST_POINTS:
            words = views.place(view, views.points[rows], rows)
        if words:
            failed[view] = words
        else:  # what could not be placed may be so now
            failed.clear()
