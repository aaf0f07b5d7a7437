"""The camera's pose from known points: ours beside OpenCV's solvers and PoseLib, in one run.

Run: ``python -m benchmarks.comparisons.pose [--scenes N]``. PoseLib is left out where it is not installed.
Random targets 24 cm wide, flat or not, 0.3 to 0.7 m away, 0.5 px of Gaussian noise on every pixel coordinate;
where there are wrong points, 30% of the pixels lie anywhere in the target's part of the image. Everybody is
given the same pixels; OpenCV and PoseLib get them on the image plane of a perspective camera with as many px
for an angle on the axis, and thresholds of 2 px there. Errors are those of every scene, of ours the likeliest
pose whatever the status (180° where there is none); "named" is how many had another status than "ok", and
"gross" how many errors exceed 10°, of ours among those that are "ok" as well.
Times are the median over the scenes of the shortest of three calls from Python.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
from benchmarks.comparisons.libraries import on_plane, peer, plane_focal
from benchmarks.stopwatch import shortest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import PoseEstimate, UnifiedCamera, estimate_pose, preset
from omniservo.geometry.arrays import FloatArray

NOISE_PX = 0.5
OUTLIERS = 0.3
THRESHOLD_PX = 2.0
GROSS_DEGREES = 10.0
CAMERAS = ("perspective", "fe185")
CASES = ((4, True, 0.0), (4, False, 0.0), (9, True, 0.0), (9, False, 0.0), (50, True, 0.0), (50, False, 0.0),
         (9, True, OUTLIERS), (9, False, OUTLIERS), (50, True, OUTLIERS), (50, False, OUTLIERS))  # fmt: skip
"""(points, flat, part of wrong points)"""

Answer = tuple[RigidTransform | None, str]


@dataclass(frozen=True)
class Picture:
    """Known points in one picture."""

    camera: UnifiedCamera
    points: FloatArray
    pixels: FloatArray
    plane: FloatArray
    """(n, 2) the bearings on a perspective image plane [px]"""
    matrix: FloatArray
    """(3, 3) of that camera"""
    reference_T_camera: RigidTransform


class Method(NamedTuple):
    """A solver: what is timed, and how its answer is read."""

    call: Callable[[Picture], Any]
    read: Callable[[Any], Answer]


@dataclass
class Score:
    """What a method did in the scenes of one case."""

    degrees: list[float] = field(default_factory=list)
    percent: list[float] = field(default_factory=list)
    """error of the camera's place, of its distance"""
    named: list[bool] = field(default_factory=list)
    microseconds: list[float] = field(default_factory=list)


def random_picture(
    rng: np.random.Generator, camera: UnifiedCamera, n: int, flat: bool, wrong: float
) -> Picture:
    """Return n points of a random target, all of them inside the image and within 70° of the axis."""
    while True:
        points = 0.12 * rng.uniform(-1, 1, (n, 3)) * ([1, 1, 0] if flat else 1)
        rotation = Rotation.from_rotvec(0.6 * rng.normal(size=3))
        aim = Rotation.from_rotvec([*(0.3 * rng.normal(size=2)), 0.0])
        middle = aim.apply([0.0, 0.0, rng.uniform(0.3, 0.7)])
        if flat and abs(rotation.apply([0.0, 0.0, 1.0]) @ middle) < 0.2 * np.linalg.norm(middle):
            continue  # seen nearly from the edge
        pixels, valid = camera.project(rotation.apply(points) + middle)
        if not (valid.all() and camera.in_image(pixels).all()):
            continue
        pixels = pixels + NOISE_PX * rng.normal(size=pixels.shape)
        lost = rng.permutation(n)[: round(wrong * n)]
        pixels[lost] = rng.uniform(pixels.min(axis=0), pixels.max(axis=0), (len(lost), 2))
        bearings, valid = camera.unproject(pixels)
        if valid.all() and bearings[:, 2].min() > math.cos(math.radians(70.0)):
            pose = RigidTransform.from_components(middle, rotation).inv()
            matrix = np.diag([plane_focal(camera), plane_focal(camera), 1.0])
            return Picture(camera, points, pixels, on_plane(camera, bearings), matrix, pose)


def ours(picture: Picture, noise: float | None = None) -> PoseEstimate:
    """Return our estimate."""
    return estimate_pose(picture.camera, picture.points, picture.pixels, noise=noise)


def _of_ours(found: PoseEstimate) -> Answer:
    return (found.poses[0] if found.poses else None), found.status


def opencv(flag: int) -> Method:
    """Return one of OpenCV's solvers, refined by its Levenberg-Marquardt on all points."""

    def solve(picture: Picture) -> Any:
        ok, turn, shift = cv2.solvePnP(picture.points, picture.plane, picture.matrix, None, flags=flag)
        if not ok:
            return None
        return cv2.solvePnPRefineLM(picture.points, picture.plane, picture.matrix, None, turn, shift)

    return Method(solve, _of_opencv)


def opencv_ransac(picture: Picture) -> Any:
    """Return OpenCV's RANSAC with SQPNP, refined on its inliers."""
    ok, turn, shift, inliers = cv2.solvePnPRansac(
        picture.points,
        picture.plane,
        picture.matrix,
        None,
        reprojectionError=THRESHOLD_PX,
        flags=cv2.SOLVEPNP_SQPNP,
    )
    if not ok or inliers is None or len(inliers) < 4:
        return None
    rows = inliers.ravel()
    return cv2.solvePnPRefineLM(picture.points[rows], picture.plane[rows], picture.matrix, None, turn, shift)


def _of_opencv(found: Any) -> Answer:
    if found is None:
        return None, "none"
    rotation = Rotation.from_rotvec(found[0].ravel()).inv()
    return RigidTransform.from_components(-rotation.apply(found[1].ravel()), rotation), "ok"


def poselib_method() -> Method | None:
    """Return PoseLib's LO-RANSAC with refinement; None where it is not installed."""
    poselib = peer("poselib")
    if poselib is None:
        return None

    def solve(picture: Picture) -> Any:
        plane = {
            "model": "SIMPLE_PINHOLE",
            "width": 2,
            "height": 2,
            "params": [picture.matrix[0, 0], 0.0, 0.0],
        }
        options = {"max_reproj_error": THRESHOLD_PX}
        return poselib.estimate_absolute_pose(picture.plane, picture.points, plane, options, {})[0]

    return Method(solve, _of_poselib)


def _of_poselib(pose: Any) -> Answer:
    if not np.isfinite(pose.R).all():
        return None, "none"
    rotation = Rotation.from_matrix(np.array(pose.R)).inv()
    return RigidTransform.from_components(-rotation.apply(np.array(pose.t)), rotation), "ok"


def methods(flat: bool, wrong: float) -> dict[str, Method]:
    """Return who is compared in a case."""
    chosen: dict[str, Method] = {"omniservo": Method(ours, _of_ours)}
    if wrong:
        chosen["OpenCV RANSAC + SQPNP + LM"] = Method(opencv_ransac, _of_opencv)
    else:
        chosen["omniservo, noise stated"] = Method(lambda p: ours(p, NOISE_PX), _of_ours)
        chosen["OpenCV SQPNP + LM"] = opencv(cv2.SOLVEPNP_SQPNP)
        chosen["OpenCV EPNP + LM"] = opencv(cv2.SOLVEPNP_EPNP)
        if flat:
            chosen["OpenCV IPPE + LM"] = opencv(cv2.SOLVEPNP_IPPE)
    poselib = poselib_method()
    if poselib is not None:
        chosen["PoseLib"] = poselib
    return chosen


def compare(camera: UnifiedCamera, n: int, flat: bool, wrong: float, scenes: int) -> dict[str, Score]:
    """Return each method's score over the same scenes."""
    rng = np.random.default_rng([n, flat, round(10 * wrong)])
    chosen = methods(flat, wrong)
    scores = {name: Score() for name in chosen}
    for _ in range(scenes):
        picture = random_picture(rng, camera, n, flat, wrong)
        for name, method in chosen.items():
            pose, status = method.read(method.call(picture))
            time = shortest(partial(method.call, picture))
            _add(scores[name], picture, pose, status, time)
    return scores


def _add(score: Score, picture: Picture, pose: RigidTransform | None, status: str, time: float) -> None:
    true = picture.reference_T_camera
    degrees, percent = 180.0, 100.0
    if pose is not None and np.isfinite(pose.as_matrix()).all():
        degrees = math.degrees((pose.rotation.inv() * true.rotation).magnitude())
        gap = float(np.linalg.norm(pose.translation - true.translation))
        percent = 100.0 * gap / float(np.linalg.norm(true.translation))
    score.degrees.append(degrees)
    score.percent.append(percent)
    score.named.append(status != "ok")
    score.microseconds.append(time)


def row(name: str, score: Score) -> str:
    """Return a method's line of the table."""
    degrees, named = np.array(score.degrees), np.array(score.named)
    gross = f"{100 * np.mean(degrees > GROSS_DEGREES):.1f}%"
    ours_only = name.startswith("omniservo")
    trusted = (
        f"{100 * np.mean(degrees[~named] > GROSS_DEGREES):.1f}%" if ours_only and not named.all() else ""
    )
    cells: list[Any] = [
        f"{np.median(degrees):.2f} / {np.percentile(degrees, 90):.2f}",
        f"{np.median(score.percent):.2f} / {np.percentile(score.percent, 90):.2f}",
        gross,
        f"{100 * named.mean():.0f}%" if ours_only else "",
        trusted,
        f"{np.median(score.microseconds):.0f}",
    ]
    return f"| {name} | " + " | ".join(cells) + " |"


def table(name: str, n: int, flat: bool, wrong: float, scenes: int) -> str:
    """Return the table of one camera and case."""
    kind = "flat" if flat else "not flat"
    scores = compare(preset(name), n, flat, wrong, scenes)
    return "\n".join(
        [
            f"\n{name}, {n} points, {kind}, {100 * wrong:.0f}% wrong, {scenes} scenes:\n",
            "| | rotation, median / p90 [deg] | place [% of distance] | gross | named | gross, ok | µs |",
            "|---|---|---|---|---|---|---|",
            *(row(method, score) for method, score in scores.items()),
        ]
    )


def main() -> None:
    """Print a table for each camera and case."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=500)
    scenes = parser.parse_args().scenes
    for name in CAMERAS:
        for case in CASES:
            print(table(name, *case, scenes), flush=True)


if __name__ == "__main__":
    main()
