"""Is the stated covariance of three to twenty views worth something?

Run: ``python -m benchmarks.many_views [SCENES]``. Random scenes of each of three cameras: points in a box of
0.30 m, 0.35 to 0.65 m away, views from within 0.3 m of the first one. The scale is the displacement between
the first two, known to `DISPLACED`. The camera that makes the pixels differs from the stated one by a smooth
random field over the image, the same in every view, whose size is stated; or its focal length is off by a
draw from 2% (1σ), which is stated as a calibration's covariance.

Counted is how often the truth lies in the 95% ellipsoid of a view's motion (6 numbers; all views of all
scenes) and in the 95% interval of the structure's size; "in σ" is the root of the median square of an error
over that of the law, 1 is right.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from omniservo.cameras import ModelError, UnifiedCamera, preset
from omniservo.estimation import KnownDisplacements, MultiViewEstimate, estimate_views
from omniservo.geometry.arrays import FloatArray

CAMERAS = ("fe185", "perspective", "para-catadioptric")

SETTINGS = ((3, 20, 0.1), (5, 60, 0.2), (10, 200, 0.1), (20, 100, 0.3))
"""views, points, noise [px]"""

FIELD_LENGTH = 0.2
"""of the image's width"""

ERRORS = ("none", "field 0.1 px", "field 0.3 px", "field 0.5 px", "focal length 2%")

DISPLACED = (5e-4, 1e-3)
"""σ of the known displacement, per axis [m], [rad]"""

FOCAL_SIGMA = 0.02


@dataclass(frozen=True, eq=False)
class ViewScene:
    """Views with their answer."""

    points: FloatArray
    """(n, 3) in the first view's camera [m]"""
    poses: list[RigidTransform]
    """first_T_view"""
    pixels: FloatArray
    """(v, n, 2) without noise"""


def view_scene(rng: np.random.Generator, camera: UnifiedCamera, views: int, n: int) -> ViewScene:
    """Return points that all views see."""
    while True:
        aim = Rotation.from_rotvec([*(0.4 * rng.normal(size=2)), 0.0])
        points = aim.apply([0.0, 0.0, rng.uniform(0.35, 0.65)]) + 0.15 * rng.uniform(-1, 1, (n, 3))
        poses, pixels = [RigidTransform.identity()], [_pixels(camera, points)]
        for _ in range(10 * views):
            if pixels[0] is None or len(poses) == views:
                break
            shift = rng.normal(size=3)
            shift *= rng.uniform(0.05, 0.3) / np.linalg.norm(shift)
            pose = RigidTransform.from_components(shift, Rotation.from_rotvec(0.2 * rng.normal(size=3)))
            seen = _pixels(camera, pose.inv().apply(points))
            if seen is not None:
                poses.append(pose)
                pixels.append(seen)
        if len(poses) == views:
            return ViewScene(points, poses, np.stack([p for p in pixels if p is not None]))


def _pixels(camera: UnifiedCamera, points: FloatArray) -> FloatArray | None:
    """Return the pixels (n, 2) of points that are all in the image, else None."""
    pixels, valid = camera.project(points)
    return pixels if valid.all() and camera.in_image(pixels).all() else None


def known_displacement(rng: np.random.Generator, scene: ViewScene) -> KnownDisplacements:
    """Return the displacement of the second view with an error of `DISPLACED`."""
    sigmas = np.repeat(DISPLACED, 3)
    off = sigmas * rng.normal(size=6)
    move = RigidTransform.from_components(
        scene.poses[1].translation + off[:3], scene.poses[1].rotation * Rotation.from_rotvec(off[3:])
    )
    return KnownDisplacements([[0, 1]], [move], np.diag(sigmas**2))


def stated_camera(exact: UnifiedCamera, error: str) -> UnifiedCamera:
    """Return the camera with the error that it states."""
    fields = exact.to_dict()
    if error.startswith("field"):
        sigma = float(error.split()[1])
        fields["model_error"] = ModelError(sigma, FIELD_LENGTH * exact.width).to_dict()
    return UnifiedCamera.from_dict(fields)


def focal_covariance(camera: UnifiedCamera) -> FloatArray:
    """Return the covariance (5, 5) of a camera whose focal lengths are off together."""
    direction = np.array([camera.fx, camera.fy, 0.0, 0.0, 0.0]) * FOCAL_SIGMA
    return np.outer(direction, direction)


def estimated(
    rng: np.random.Generator, exact: UnifiedCamera, setting: tuple[int, int, float], error: str
) -> tuple[ViewScene, MultiViewEstimate]:
    """Return a scene and what is estimated of it."""
    views, n, noise = setting
    stated, covariance, scene = stated_camera(exact, error), None, view_scene(rng, exact, views, n)
    pixels = scene.pixels + noise * rng.normal(size=scene.pixels.shape)
    if stated.model_error is not None:
        moves = stated.model_error.moves(np.swapaxes(scene.pixels, 0, 1).reshape(n, 2 * views))
        planted = np.einsum("k,knc->nc", rng.standard_normal(len(moves)), moves)
        pixels += np.swapaxes(planted.reshape(n, views, 2), 0, 1)
    elif error.startswith("focal"):
        factor = 1.0 + FOCAL_SIGMA * rng.standard_normal()
        stated = UnifiedCamera.from_dict(
            {**exact.to_dict(), "fx": exact.fx / factor, "fy": exact.fy / factor}
        )
        covariance = focal_covariance(stated)
    visible = stated.unproject(pixels)[1]
    found = estimate_views(
        stated,
        pixels,
        visible=visible,
        noise=noise,
        scale=known_displacement(rng, scene),
        calibration_covariance=covariance,
    )
    return scene, found


def squares_of(scene: ViewScene, found: MultiViewEstimate) -> tuple[list[float], float]:
    """Return the squared error of every view's motion in its covariance, and that of the structure's size."""
    squares = []
    for pose, true, spread in zip(
        found.initial_T_views[1:], scene.poses[1:], found.covariance[1:], strict=True
    ):
        if pose is not None:
            turn = (true.rotation.inv() * pose.rotation).as_rotvec()
            off = np.concatenate((pose.translation - true.translation, turn))
            squares.append(float(off @ np.linalg.solve(spread, off)))
    placed = ~np.isnan(found.points[:, 0])
    ratio = np.linalg.norm(found.points[placed]) / np.linalg.norm(scene.points[placed])
    return squares, (math.log(ratio) / found.size_sigma) ** 2


def coverage(name: str, setting: tuple[int, int, float], error: str, scenes: int) -> dict[str, float]:
    """Return shares of scenes, views and sizes."""
    exact, rng = preset(name), np.random.default_rng([20261126, *setting[:2]])
    motions: list[float] = []
    sizes: list[float] = []
    for _ in range(scenes):
        scene, found = estimated(rng, exact, setting, error)
        if found.status == "ok":
            squares, size = squares_of(scene, found)
            motions += squares
            sizes.append(size)
    return {
        "ok": len(sizes) / scenes,
        "motion": float(np.mean(np.array(motions) < chi2.ppf(0.95, 6))),
        "size": float(np.mean(np.array(sizes) < chi2.ppf(0.95, 1))),
        "in sigma": math.sqrt(float(np.median(motions)) / float(chi2.ppf(0.5, 6))),
    }


def lines(scenes: int = 100) -> Iterator[str]:
    """Measure and give a Markdown table, row by row: motion / size covered [%], (in σ)."""
    yield "| views | points | noise [px] | camera | " + " | ".join(ERRORS) + " |"
    yield "|" + "---|" * (4 + len(ERRORS))
    for setting in SETTINGS:
        for name in CAMERAS:
            cells = []
            for error in ERRORS:
                found = coverage(name, setting, error, scenes)
                lost = "" if found["ok"] == 1.0 else f", {100.0 * found['ok']:.0f}% ok"
                covered = f"{100.0 * found['motion']:.0f} / {100.0 * found['size']:.0f}"
                cells.append(f"{covered} ({found['in sigma']:.2f}{lost})")
            yield f"| {setting[0]} | {setting[1]} | {setting[2]:g} | {name} | " + " | ".join(cells) + " |"


def main() -> None:
    """Print the table."""
    for line in lines(*(int(a) for a in sys.argv[1:2])):
        print(line, flush=True)


if __name__ == "__main__":
    main()
