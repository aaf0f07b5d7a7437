"""Is the stated covariance of three to twenty views worth something?

Run: ``python -m benchmarks.many_views [SCENES]``, or with ``--real``. Random scenes of each of three cameras:
points in a box of 0.30 m, 0.35 to 0.65 m away, views from within 0.3 m of the first one. The scale is the
displacement between the first two, known to `DISPLACED`. The camera that makes the pixels differs from the
stated one by a smooth random field over the image, the same in every view, whose size is stated; or its focal
length is off by a draw from 2% (1σ), which is stated as a calibration's covariance.

Counted is how often the truth lies in the 95% ellipsoid of a view's motion (6 numbers; all views of all
scenes) and in the 95% interval of the structure's size; "in σ" is the root of the median square of an error
over that of the law, 1 is right.

With ``--real``: random subsets of the images of two sets in ../shared/data, in random order, natural features
off the board, own calibration with its covariance, truth and score as in `benchmarks.real_coverage`, every
joined image against the one whose frame it is; beside it each image alone with that one (two views).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from benchmarks.real_coverage import (
    DATA,
    LEAST_MATCHES,
    SETS,
    RealSet,
    Score,
    calibrated_camera,
    score,
    score_of,
)
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from omniservo.calibration import Calibration
from omniservo.cameras import ModelError, UnifiedCamera, preset
from omniservo.estimation import (
    KnownDisplacements,
    MultiViewEstimate,
    ViewPoints,
    estimate_two_view,
    estimate_views,
)
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import NaturalKind, join_images

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


SIZES = (3, 5, 8)
SUBSETS = 8


def real_scores(
    data: RealSet, calibration: Calibration, size: int, rng: np.random.Generator
) -> tuple[int, list[Score], list[Score]]:
    """Return how many images a subset could join, and the scores by all of its images and by pairs."""
    camera = calibrated_camera(calibration, "calibration")
    names = [list(data.images)[k] for k in rng.permutation(len(data.images))[:size]]
    joined = join_images(camera, [data.images[name] for name in names], NaturalKind())
    visible = joined.visible.copy()
    for view, name in enumerate(names):
        seen = np.flatnonzero(visible[view])
        visible[view, seen] = ~data.beside_board(name, joined.pixels[view, seen])
    kept = visible.sum(axis=0) > 1
    if not kept.any() or joined.noise is None or joined.window is None:
        return 0, [], []
    parts = (joined.pixels[:, kept], visible[:, kept], joined.noise[:, kept], joined.window[:, kept])
    found = estimate_views(camera, ViewPoints(*parts))
    many: list[Score] = []
    pairs: list[Score] = []
    if found.reference is None:
        return 0, many, pairs
    first = found.reference
    for view, pose in enumerate(found.initial_T_views):
        if pose is None or view == first:
            continue
        truth = data.truth(names[first], names[view])
        many.append(score_of(pose, found.covariance[view], truth))
        both = parts[1][first] & parts[1][view]
        if both.sum() < LEAST_MATCHES:
            continue
        two = estimate_two_view(
            camera,
            parts[0][first, both],
            parts[0][view, both],
            noise=parts[2][[first, view]][:, both].T,
            windows=parts[3][first, both],
        )
        if two.initial_T_goal is not None:
            pairs.append(score(two, truth))
    return len(many) + 1, many, pairs


def real_lines(subsets: int = SUBSETS) -> Iterator[str]:
    """Measure and give a Markdown table, row by row."""
    yield (
        "| set | images | subsets | joined | by | motions | rotation median / worst [°] "
        "| direction median / worst [°] | in σ | 95% holds |"
    )
    yield "|" + "---|" * 10
    for name in SETS:
        data = RealSet.read(name)
        calibration = data.calibrated()
        for size in SIZES:
            if size > len(data.images):
                continue
            rng, joined = np.random.default_rng([20261126, size]), 0
            scores: dict[str, list[Score]] = {"all images": [], "pairs": []}
            for _ in range(subsets):
                count, many, pairs = real_scores(data, calibration, size, rng)
                joined += count
                scores["all images"] += many
                scores["pairs"] += pairs
            for by, listed in scores.items():
                said = f"{joined} of {size * subsets}"
                yield f"| {name} | {size} | {subsets} | {said} | {by} | {_of_scores(listed)} |"


def _of_scores(scores: list[Score]) -> str:
    if not scores:
        return "0 | – | – | – | –"
    turns, swings = ([getattr(s, k) for s in scores] for k in ("rotation_deg", "direction_deg"))
    squares = np.array([s.square for s in scores])
    sigmas = math.sqrt(float(np.median(squares)) / float(chi2.ppf(0.5, 5)))
    held = 100.0 * np.mean(squares <= chi2.ppf(0.95, 5))
    return (
        f"{len(scores)} | {np.median(turns):.2f} / {max(turns):.2f} "
        f"| {np.median(swings):.2f} / {max(swings):.2f} | {sigmas:.1f} | {held:.0f}%"
    )


def main() -> None:
    """Print the table."""
    numbers = [int(a) for a in sys.argv[1:] if a != "--real"]
    if "--real" not in sys.argv:
        made = lines(*numbers[:1])
    elif all((DATA / name).is_dir() for name in SETS):
        made = real_lines(*numbers[:1])
    else:
        print("real data not present: ../shared/data")
        return
    for line in made:
        print(line, flush=True)


if __name__ == "__main__":
    main()
