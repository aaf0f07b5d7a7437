"""Motion and structure: accuracy over random fisheye scenes, and time.

Run: ``python -m benchmarks.estimation_speed``. Accuracy: nine points over about 60 px, 300 scenes, Gaussian
noise on every pixel coordinate; the bound is the same refinement started at the truth. "Minimum" is the best
minimum of every scene, whatever its status; "answers" are those of `estimate_two_view` with status "ok".
Times are medians of the processor time of warm calls: "search" is the starts and the refinement, arrays in,
minima out; "public" is `estimate_two_view`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.estimation import estimate_two_view, refine_pose_kernel
from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.joint_refinement import refine_jointly
from omniservo.estimation.refinement.motion_search import START_ANGLES, eight_point_starts, search_motion
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.quaternions import QUATERNION

GROSS_DEGREES = 10.0


@dataclass
class Scene:
    """A scene with its answer."""

    points: FloatArray
    initial_T_goal: RigidTransform
    pixels_initial: FloatArray
    pixels_goal: FloatArray


@dataclass
class Accuracy:
    """Rotation errors over many scenes [deg], and how many answers there were."""

    median: float
    p90: float
    gross: float
    answered: float


def random_scene(rng: np.random.Generator, camera: UnifiedCamera, n: int = 9, noise: float = 0.5) -> Scene:
    """Return n points in a box of 0.30 m, 0.35 to 0.65 m away, seen before and after a random motion."""
    while True:
        aim = Rotation.from_rotvec([*(0.4 * rng.normal(size=2)), 0.0])
        points = aim.apply([0.0, 0.0, rng.uniform(0.35, 0.65)]) + 0.15 * rng.uniform(-1, 1, (n, 3))
        direction = rng.normal(size=3)
        pose = RigidTransform.from_components(
            rng.uniform(0.15, 0.35) * direction / np.linalg.norm(direction),
            Rotation.from_rotvec(0.3 * rng.normal(size=3)),
        )
        goal = pose.inv().apply(points)
        images = [camera.project(p) for p in (points, goal)]
        noisy = [pixels + noise * rng.normal(size=pixels.shape) for pixels, _ in images]
        seen = [valid.all() and camera.in_image(pixels).all() for pixels, valid in images]
        if all(seen) and all(camera.unproject(pixels)[1].all() for pixels in noisy):
            break
    return Scene(points, pose, noisy[0], noisy[1])


def rotation_accuracy(kind: str, noise: float = 0.5, scenes: int = 300) -> Accuracy:
    """Return the rotation errors of nine-point scenes; ``kind``: "answers", "minimum" or "bound"."""
    camera, rng = preset("fe185"), np.random.default_rng(1)
    solve = {"answers": _answer, "minimum": _minimum, "bound": _bound}[kind]
    errors = []
    for _ in range(scenes):
        scene = random_scene(rng, camera, noise=noise)
        found = solve(camera, scene)
        if found is not None:
            errors.append(math.degrees((found.inv() * scene.initial_T_goal.rotation).magnitude()))
    values = np.array(errors)
    return Accuracy(
        float(np.median(values)),
        float(np.percentile(values, 90)),
        float(np.mean(values > GROSS_DEGREES)),
        len(values) / scenes,
    )


def _answer(camera: UnifiedCamera, scene: Scene) -> Rotation | None:
    estimate = estimate_two_view(camera, scene.pixels_initial, scene.pixels_goal)
    return None if estimate.initial_T_goal is None else estimate.initial_T_goal.rotation


def _minimum(camera: UnifiedCamera, scene: Scene) -> Rotation | None:
    matches = Matches.of_pixels(camera, np.hstack([scene.pixels_initial, scene.pixels_goal]))
    minima = search_motion(matches, QUATERNION, eight_point_starts(matches.bearings, START_ANGLES))
    return Rotation.from_matrix(minima[0].rotation) if minima else None


def _bound(camera: UnifiedCamera, scene: Scene) -> Rotation | None:
    r, t = scene.initial_T_goal.rotation.as_matrix(), np.array(scene.initial_T_goal.translation)
    pixels = np.hstack([scene.pixels_initial, scene.pixels_goal])
    weights, points = np.ones((len(pixels), 2)), scene.points.copy()
    refine_jointly(camera.parameters, pixels, weights, QUATERNION, r, t, points, 200)
    return Rotation.from_matrix(r)


def estimation_microseconds(n: int = 9, noise: float = 0.05, scenes: int = 100) -> tuple[float, float]:
    """Return the median times of the search and of the public call for n points [µs]."""
    camera, rng = preset("fe185"), np.random.default_rng(2)
    angles = START_ANGLES if n < 40 else START_ANGLES[:1]
    search, public = [], []
    for _ in range(scenes):
        scene = random_scene(rng, camera, n, noise)
        pixels = np.hstack([scene.pixels_initial, scene.pixels_goal])

        def solve(pixels: FloatArray = pixels) -> object:
            matches = Matches.of_pixels(camera, pixels)
            return search_motion(matches, QUATERNION, eight_point_starts(matches.bearings, angles))

        def estimate(scene: Scene = scene) -> object:
            return estimate_two_view(camera, scene.pixels_initial, scene.pixels_goal)

        search.append(_fastest(solve))
        public.append(_fastest(estimate))
    return float(np.median(search)), float(np.median(public))


def wrong_matches_microseconds(n: int = 100, noise: float = 0.05, scenes: int = 30) -> float:
    """Return the median time of the public call for n points, 30% of which are matched to each other [µs]."""
    camera, rng, times = preset("fe185"), np.random.default_rng(2), []
    for _ in range(scenes):
        scene = random_scene(rng, camera, n, noise)
        wrong = rng.choice(n, round(0.3 * n), replace=False)
        goal = scene.pixels_goal.copy()
        goal[wrong] = goal[np.roll(wrong, 1)]

        def estimate(initial: FloatArray = scene.pixels_initial, goal: FloatArray = goal) -> object:
            return estimate_two_view(camera, initial, goal, noise=noise)

        times.append(_fastest(estimate))
    return float(np.median(times))


def pose_refinement_microseconds(n: int = 9, noise: float = 0.05, scenes: int = 100) -> float:
    """Return the median time of the pose kernel from a guess 5 mm and 1° off [µs]."""
    camera, rng = preset("fe185"), np.random.default_rng(3)
    times, valid = [], np.ones(n, dtype=np.bool_)
    for _ in range(scenes):
        scene = random_scene(rng, camera, n, noise)
        pose = scene.initial_T_goal
        quaternion = (pose.rotation * Rotation.from_rotvec([0.01, -0.01, 0.01])).as_quat()
        translation = np.array(pose.translation) + 0.003

        def refine(scene: Scene = scene, q: FloatArray = quaternion, t: FloatArray = translation) -> object:
            return refine_pose_kernel(camera.parameters, scene.points, scene.pixels_goal, valid, q, t)

        times.append(_fastest(refine))
    return float(np.median(times))


def _fastest(call: Callable[[], object]) -> float:
    """Return the least processor time of five calls after a first one [µs]."""
    call()
    times = []
    for _ in range(5):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return 1e6 * min(times)


def main() -> None:
    """Print accuracy and times."""
    for noise in (0.5, 0.1, 0.02):
        for kind in ("minimum", "answers", "bound"):
            a = rotation_accuracy(kind, noise)
            print(
                f"9 points, {noise} px, {kind}: rotation error {a.median:.2f} / {a.p90:.2f} deg"
                f" (median / p90), gross {100 * a.gross:.0f}%, answered {100 * a.answered:.0f}%"
            )
    for n in (9, 100):
        search, public = estimation_microseconds(n)
        print(f"{n} points: search {search:.0f} us, public call {public:.0f} us (median)")
    print(f"100 points, 30% wrong, noise stated: public call {wrong_matches_microseconds():.0f} us (median)")
    for n in (20, 100, 300):
        public = estimation_microseconds(n, noise=0.5, scenes=30)[1]
        print(
            f"{n} points, 0.5 px, a plane that moves by itself is looked for: {public / 1e3:.1f} ms (median)"
        )
    print(f"pose refinement, 9 points: {pose_refinement_microseconds():.1f} us (median)")


if __name__ == "__main__":
    main()
