"""Motion from two images: ours beside pycolmap, PoseLib and OpenCV, in one run.

Run: ``python -m benchmarks.comparisons.motion [--scenes N]``; pycolmap and PoseLib are left out where they
are not installed. Scenes as in `estimation_speed`: points in a box of 0.30 m, 0.35 to 0.65 m away and within
70° of the axis in both images, which see it over 60 to 110 px; Gaussian noise of 0.5 px on each coordinate;
where there are wrong matches, 30% of the goal's pixels lie anywhere in the target's part of
the image. Everybody is given the same pixels and a threshold of 2 px (ours finds its own): pycolmap in the
real image, where its EUCM camera equals the unified one (β = 1, α = ξ/(1+ξ), f/(1+ξ)); PoseLib and OpenCV on
the image plane of a perspective camera with as many px for an angle on the axis. pycolmap and PoseLib draw at
least 1 000 samples unless stated otherwise; they stand there with 100 as well.

Errors are those of every scene, 180° and 90° where there is no answer; "omniservo, ok" counts only scenes
whose status is "ok". The bound is our refinement started at the truth, with the right matches alone. Times
are medians over the scenes of the shortest of three calls from Python.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import cv2
import numpy as np
from benchmarks.comparisons.libraries import on_plane, peer, plane_focal
from benchmarks.estimation_speed import random_scene
from benchmarks.stopwatch import shortest
from scipy.spatial.transform import RigidTransform

from omniservo import UnifiedCamera, estimate_two_view, preset
from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.joint_refinement import refine_jointly
from omniservo.estimation.robust.two_view_fit import fit_two_views
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.quaternions import QUATERNION

NOISE_PX = 0.5
OUTLIERS = 0.3
THRESHOLD_PX = 2.0
SAMPLES = (1000, 100)
WIDEST = math.radians(70.0)
GROSS_DEGREES, SUCCESS_DEGREES = 10.0, 5.0
CAMERAS = ("fe185", "perspective", "para-catadioptric")
CASES = ((9, 0.0), (20, 0.0), (100, 0.0), (100, OUTLIERS))
"""(matches, part of wrong ones)"""

OURS, OURS_OK = "omniservo", "omniservo, ok"
Motion = tuple[FloatArray, FloatArray]
"""R (3, 3) and t (3,) of b ∝ R b* + t/d"""


@dataclass(frozen=True)
class Pair:
    """Two images of the same points."""

    camera: UnifiedCamera
    initial: FloatArray
    goal: FloatArray
    plane: tuple[FloatArray, FloatArray]
    """the same bearings on a perspective image plane [px]"""
    right: BoolArray
    points: FloatArray
    initial_T_goal: RigidTransform


@dataclass
class Score:
    """What a method did in the scenes of one case."""

    rotation: list[float] = field(default_factory=list)
    direction: list[float] = field(default_factory=list)
    microseconds: list[float] = field(default_factory=list)


def random_pair(rng: np.random.Generator, camera: UnifiedCamera, n: int, wrong: float) -> Pair:
    """Return a scene of `estimation_speed` that lies within 70° of the axis in both images."""
    while True:
        scene = random_scene(rng, camera, n, NOISE_PX)
        goal = scene.pixels_goal.copy()
        lost = rng.permutation(n)[: round(wrong * n)]
        goal[lost] = rng.uniform(goal.min(axis=0), goal.max(axis=0), (len(lost), 2))
        bearings = [camera.unproject(pixels) for pixels in (scene.pixels_initial, goal)]
        if all(valid.all() and b[:, 2].min() > math.cos(WIDEST) for b, valid in bearings):
            break
    right = np.ones(n, dtype=np.bool_)
    right[lost] = False
    plane = (on_plane(camera, bearings[0][0]), on_plane(camera, bearings[1][0]))
    return Pair(camera, scene.pixels_initial, goal, plane, right, scene.points, scene.initial_T_goal)


def ours(pair: Pair) -> Any:
    """Return the best motion, whatever will be said of it."""
    matches = Matches.of_pixels(pair.camera, np.hstack([pair.initial, pair.goal]))
    fit = fit_two_views(matches, QUATERNION, robust=True)
    return (fit.minima[0].rotation, fit.minima[0].translation) if fit is not None and fit.minima else None


def ours_ok(pair: Pair) -> Any:
    """Return what `estimate_two_view` answers."""
    return estimate_two_view(pair.camera, pair.initial, pair.goal).initial_T_goal


def bound(pair: Pair) -> Any:
    """Return the minimum of the right matches that the truth lies in."""
    pixels = np.hstack([pair.initial, pair.goal])[pair.right]
    points = pair.points[pair.right].copy()
    r, t = pair.initial_T_goal.rotation.as_matrix(), np.array(pair.initial_T_goal.translation)
    weights = np.ones((len(pixels), 2))
    refine_jointly(pair.camera.parameters, pixels, weights, QUATERNION, r, t, points, 200)
    return r, t


def opencv(method: int, pair: Pair) -> Any:
    """Return the motion that OpenCV decomposes its essential matrix into."""
    f = plane_focal(pair.camera)
    goal, initial = pair.plane[1], pair.plane[0]
    essential, mask = cv2.findEssentialMat(goal, initial, np.diag([f, f, 1.0]), method, 0.9999, THRESHOLD_PX)
    if essential is None or essential.shape != (3, 3):
        return None
    _, rotation, translation, _ = cv2.recoverPose(essential, goal, initial, np.diag([f, f, 1.0]), mask=mask)
    return rotation, translation.ravel()


def of_poselib(poselib: Any, samples: int, pair: Pair) -> Any:
    """Return PoseLib's LO-RANSAC with its refinement."""
    plane = {
        "model": "SIMPLE_PINHOLE",
        "width": 2,
        "height": 2,
        "params": [plane_focal(pair.camera), 0.0, 0.0],
    }
    options = {"max_epipolar_error": THRESHOLD_PX, "min_iterations": samples}
    pose, _ = poselib.estimate_relative_pose(pair.plane[1], pair.plane[0], plane, plane, options, {})
    return np.array(pose.R), np.array(pose.t)


def of_pycolmap(pycolmap: Any, camera: Any, samples: int, pair: Pair) -> Any:
    """Return pycolmap's LO-RANSAC on the real pixels, refined on its inliers."""
    options = pycolmap.RANSACOptions(max_error=THRESHOLD_PX, min_num_trials=samples)
    found = pycolmap.estimate_essential_matrix(pair.goal, pair.initial, camera, camera, options)
    if found is None:
        return None
    refined = pycolmap.refine_relative_pose(
        found["cam2_from_cam1"], camera, pair.goal, camera, pair.initial, found["inlier_mask"]
    )
    matrix = (found if refined is None else refined)["cam2_from_cam1"].matrix()
    return matrix[:, :3], matrix[:, 3]


def methods(camera: UnifiedCamera) -> dict[str, Callable[[Pair], Any]]:
    """Return who is compared."""
    chosen: dict[str, Callable[[Pair], Any]] = {"bound": bound, OURS: ours, OURS_OK: ours_ok}
    pycolmap, poselib = peer("pycolmap"), peer("poselib")
    if pycolmap is not None:
        stretch = 1.0 + camera.xi
        numbers = [camera.fx / stretch, camera.fy / stretch, camera.cx, camera.cy, camera.xi / stretch, 1.0]
        eucm = pycolmap.Camera(model="EUCM", width=camera.width, height=camera.height, params=numbers)
        for samples in SAMPLES:
            chosen[f"pycolmap, {samples} samples"] = partial(of_pycolmap, pycolmap, eucm, samples)
    if poselib is not None:
        for samples in SAMPLES:
            chosen[f"PoseLib, {samples} samples"] = partial(of_poselib, poselib, samples)
    chosen["OpenCV RANSAC"] = partial(opencv, cv2.RANSAC)
    chosen["OpenCV USAC (MAGSAC)"] = partial(opencv, cv2.USAC_MAGSAC)
    return chosen


def errors(found: Any, true: RigidTransform) -> tuple[float, float]:
    """Return the angles between the rotations and between the translations [deg]."""
    if found is None:
        return 180.0, 90.0
    if isinstance(found, RigidTransform):
        found = (found.rotation.as_matrix(), np.array(found.translation))
    chord = float(np.linalg.norm(found[0] - true.rotation.as_matrix()))
    along = float(found[1] @ true.translation) / float(
        np.linalg.norm(found[1]) * np.linalg.norm(true.translation)
    )
    return (
        math.degrees(2.0 * math.asin(min(1.0, chord / math.sqrt(8.0)))),
        math.degrees(math.acos(max(-1.0, min(1.0, along)))),
    )


def compare(camera: UnifiedCamera, n: int, wrong: float, scenes: int) -> dict[str, Score]:
    """Return each method's score over the same scenes."""
    rng = np.random.default_rng([n, round(10 * wrong)])
    chosen = methods(camera)
    scores = {name: Score() for name in chosen}
    for _ in range(scenes):
        pair = random_pair(rng, camera, n, wrong)
        for name, method in chosen.items():
            found = method(pair)
            if name == OURS_OK and found is None:
                continue
            turn, swing = errors(found, pair.initial_T_goal)
            scores[name].rotation.append(turn)
            scores[name].direction.append(swing)
            scores[name].microseconds.append(shortest(partial(method, pair)))
    return scores


def row(name: str, score: Score, scenes: int) -> str:
    """Return a method's line of the table."""
    turn, swing = np.array(score.rotation), np.array(score.direction)
    cells = [
        f"{np.median(turn):.2f} / {np.percentile(turn, 90):.2f}",
        f"{np.median(swing):.2f} / {np.percentile(swing, 90):.2f}",
        f"{100 * np.mean(turn > GROSS_DEGREES):.1f}%",
        f"{100 * np.mean(turn < SUCCESS_DEGREES):.1f}%",
        f"{100 * len(turn) / scenes:.0f}%",
        "" if name == "bound" else f"{np.median(score.microseconds):.0f}",
    ]
    return f"| {name} | " + " | ".join(cells) + " |"


def table(name: str, n: int, wrong: float, scores: dict[str, Score], scenes: int) -> str:
    """Return the table of one camera and case."""
    return "\n".join(
        [
            f"\n{name}, {n} matches, {100 * wrong:.0f}% of them wrong, {scenes} scenes:\n",
            "| | rotation, median / p90 [deg] | direction, median / p90 [deg] | rotation > 10° | < 5° |"
            " answered | µs |",
            "|---|---|---|---|---|---|---|",
            *(row(method, score, scenes) for method, score in scores.items()),
        ]
    )


def main() -> None:
    """Print a table for each camera and case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--camera", choices=CAMERAS, action="append")
    given = parser.parse_args()
    for name in given.camera or CAMERAS:
        for n, wrong in CASES:
            scores = compare(preset(name), n, wrong, given.scenes)
            print(table(name, n, wrong, scores, given.scenes), flush=True)


if __name__ == "__main__":
    main()
