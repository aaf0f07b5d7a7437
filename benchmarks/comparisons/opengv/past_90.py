"""Relative and absolute pose on bearings of which half and more lie past 90°: ours beside OpenGV.

Run: ``python -m benchmarks.comparisons.opengv.past_90 [--scenes N]``; it needs Debian's libopengv-dev and a
C++ compiler. PoseLib, pycolmap and OpenCV need an image plane, OpenGV takes bearings as ours does. The
camera is the preset para-catadioptric, which sees to 101°; all points are seen past 75°, half and more of
them past 90°, in both images (0.06 to 0.25 m and 0.2 rad (1 σ) apart); absolute poses are of such points in
a frame of their own. Pixels have Gaussian noise; where there are wrong ones, 30% lie anywhere in the
target's part of the image. OpenGV gets the bearings of the same pixels, and as threshold the angle of 4 σ
there; ours finds its own.

OpenGV's methods end with its nonlinear optimisation: on all bearings after its eight-point method, EPnP and
UPnP, on the inliers after RANSAC (1 000 samples; Nistér's five points, Kneip's three). "omniservo" is the
best minimum, whatever will be said of it; "omniservo, ok" the public function, in the scenes whose status
is "ok". Errors are those of every scene, 180° and 90° or 100% where there is no answer. Times are medians
of the shortest of three calls, OpenGV's in C++, ours from Python.
"""

from __future__ import annotations

import argparse
import math
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.comparisons.motion import errors
from benchmarks.stopwatch import shortest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import UnifiedCamera, estimate_pose, estimate_two_view, preset
from omniservo.estimation.matches import Matches
from omniservo.estimation.robust.two_view_fit import fit_two_views
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.quaternions import QUATERNION

PROGRAM = Path(__file__).with_name("solve.cpp")
PACKAGE = "libopengv-dev"
CAMERA = "para-catadioptric"
NOISES_PX = (0.1, 0.5, 1.0)
WRONG = 0.3
MATCHES = ((20, 0.0), (100, 0.0), (100, WRONG))
POINTS = ((6, 0.0), (20, 0.0), (50, WRONG))
"""(how many, part of wrong ones)"""

NEAREST_COS, HALF_COS = math.cos(math.radians(75.0)), 0.0
THRESHOLD_SIGMAS = 4.0
GROSS_DEGREES = 10.0
RESAMPLINGS, SURE = 1000, 0.995
OURS, OURS_OK = "omniservo", "omniservo, ok"
NAMES = {
    "ransac": "OpenGV RANSAC",
    "eight-point": "OpenGV eight-point",
    "epnp": "OpenGV EPnP",
    "upnp": "OpenGV UPnP",
}

Motion = tuple[FloatArray, FloatArray]
"""R (3, 3), t (3,)"""


@dataclass(frozen=True)
class Scene:
    """What both are given, and the truth."""

    camera: UnifiedCamera
    pixels: FloatArray
    """(n, 2) in the initial image, or in the only one"""
    second: FloatArray
    """(n, 2) in the goal image, or (n, 3) known points [m]"""
    pose: RigidTransform
    """initial_T_goal, or reference_T_camera"""

    @property
    def two_views(self) -> bool:
        """Whether it is one of two images."""
        return self.second.shape[1] == 2


@dataclass
class Score:
    """What a method did in the scenes of one case."""

    rotation: list[float] = field(default_factory=list)
    """[deg]"""
    place: list[float] = field(default_factory=list)
    """of two views the direction [deg], else the camera's place [% of its distance]"""
    microseconds: list[float] = field(default_factory=list)

    def add(self, scene: Scene, found: Motion | None, microseconds: float) -> None:
        """Count an answer."""
        finite = found if found is not None and all(np.isfinite(part).all() for part in found) else None
        turn, swing = errors(finite, scene.pose)
        if not scene.two_views:
            true = np.array(scene.pose.translation)
            swing = 100.0 if finite is None else float(100.0 * np.linalg.norm(finite[1] - true))
            swing /= 1.0 if finite is None else float(np.linalg.norm(true))
        self.rotation.append(turn)
        self.place.append(swing)
        self.microseconds.append(microseconds)


def draw_scene(
    rng: np.random.Generator, camera: UnifiedCamera, case: tuple[int, float], noise: float, two_views: bool
) -> Scene:
    """Return points past 90° of which both images (or the one) see all."""
    n, wrong = case
    while True:
        points, goal = _points(rng), _moved(rng)
        seen = [_past(camera, view) for view in (points, goal.inv().apply(points))]
        usable, far = seen[0][0] & seen[1][0], seen[0][1] & seen[1][1]
        least = math.ceil(n / 2)
        if far.sum() < least or usable.sum() < n:
            continue
        chosen = np.flatnonzero(far)[:least]
        points = points[np.concatenate([chosen, np.setdiff1d(np.flatnonzero(usable), chosen)[: n - least]])]
        first = _noisy(rng, camera, points, noise)
        second = _noisy(rng, camera, goal.inv().apply(points), noise)
        lost = rng.permutation(n)[: round(wrong * n)]
        spoilt = second if two_views else first
        spoilt[lost] = rng.uniform(spoilt.min(axis=0), spoilt.max(axis=0), (len(lost), 2))
        if not all(camera.unproject(pixels)[1].all() for pixels in (first, second)):
            continue
        if two_views:
            return Scene(camera, first, second, goal)
        frame = RigidTransform.from_components(points.mean(axis=0), Rotation.random(rng=rng))
        return Scene(camera, first, frame.inv().apply(points), frame.inv())


def _points(rng: np.random.Generator) -> FloatArray:
    """Return candidates (400, 3) in a box of 0.24 m, 0.35 to 0.65 m away, some 90° from the axis."""
    angle, around = math.radians(rng.uniform(86.0, 96.0)), rng.uniform(-math.pi, math.pi)
    aim = [math.sin(angle) * math.cos(around), math.sin(angle) * math.sin(around), math.cos(angle)]
    points: FloatArray = rng.uniform(0.35, 0.65) * np.array(aim) + 0.12 * rng.uniform(-1, 1, (400, 3))
    return points


def _moved(rng: np.random.Generator) -> RigidTransform:
    way = rng.normal(size=3)
    return RigidTransform.from_components(
        rng.uniform(0.06, 0.25) * way / np.linalg.norm(way), Rotation.from_rotvec(0.2 * rng.normal(size=3))
    )


def _past(camera: UnifiedCamera, view: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return which points (in the camera frame) are seen past 75°, and which past 90°."""
    pixels, valid = camera.project(view)
    cosine = view[:, 2] / np.linalg.norm(view, axis=1)
    seen = valid & camera.in_image(np.where(valid[:, None], pixels, -1.0)) & (cosine < NEAREST_COS)
    return seen, seen & (cosine < HALF_COS)


def _noisy(rng: np.random.Generator, camera: UnifiedCamera, view: FloatArray, noise: float) -> FloatArray:
    pixels = camera.project(view)[0]
    return np.array(pixels + noise * rng.normal(size=pixels.shape))


def ours(scene: Scene) -> Motion | None:
    """Return our likeliest answer, whatever will be said of it."""
    if scene.two_views:
        matches = Matches.of_pixels(scene.camera, np.hstack([scene.pixels, scene.second]))
        fit = fit_two_views(matches, QUATERNION, robust=True)
        return (fit.minima[0].rotation, fit.minima[0].translation) if fit is not None and fit.minima else None
    poses = estimate_pose(scene.camera, scene.second, scene.pixels).poses
    return _parts(poses[0]) if poses else None


def ours_ok(scene: Scene) -> Motion | None:
    """Return what the public function answers; None: its status is not "ok"."""
    if scene.two_views:
        pose = estimate_two_view(scene.camera, scene.pixels, scene.second).initial_T_goal
    else:
        pose = estimate_pose(scene.camera, scene.second, scene.pixels).reference_T_camera
    return None if pose is None else _parts(pose)


def _parts(pose: RigidTransform) -> Motion:
    return pose.rotation.as_matrix(), np.array(pose.translation)


def text_of(scene: Scene, noise: float) -> str:
    """Return the scene as `solve.cpp` reads it."""
    bearings = scene.camera.unproject(scene.pixels)[0]
    second = scene.camera.unproject(scene.second)[0] if scene.two_views else scene.second
    beside = scene.camera.unproject(scene.pixels + np.array([0.0, 1.0]))
    per_px = np.linalg.norm(beside[0] - bearings, axis=1)[beside[1]]
    angle = THRESHOLD_SIGMAS * noise * float(np.median(per_px))
    head = f"{'relative' if scene.two_views else 'absolute'} {angle!r} {len(bearings)}\n"
    rows = np.hstack([bearings, second])
    return head + "".join(" ".join(repr(float(x)) for x in row) + "\n" for row in rows)


def built(folder: Path) -> Path | str:
    """Return the compiled program, or why there is none."""
    compiler = shutil.which("g++")
    if compiler is None:
        return "there is no g++"
    program = folder / "solve"
    command = [compiler, "-O2", "-w", "-I/usr/include/eigen3", str(PROGRAM), "-o", str(program), "-lopengv"]
    made = subprocess.run(command, capture_output=True, text=True)
    if made.returncode:
        return f"Debian's {PACKAGE} (with libeigen3-dev) is not installed: {made.stderr.splitlines()[-1]}"
    return program


def compare(
    program: Path, case: tuple[int, float], noise: float, two_views: bool, scenes: int
) -> dict[str, Score]:
    """Return each method's score over the same scenes."""
    rng = np.random.default_rng([case[0], round(10 * case[1]), round(10 * noise), two_views])
    drawn = [draw_scene(rng, preset(CAMERA), case, noise, two_views) for _ in range(scenes)]
    scores = {OURS: Score(), OURS_OK: Score()}
    for scene in drawn:
        scores[OURS].add(scene, ours(scene), shortest(partial(ours, scene)))
        answer = ours_ok(scene)
        if answer is not None:
            scores[OURS_OK].add(scene, answer, shortest(partial(ours_ok, scene)))
    given = "".join(text_of(scene, noise) for scene in drawn)
    printed = subprocess.run([program], input=given, capture_output=True, text=True, check=True).stdout
    for line in printed.splitlines():
        number, method, taken_there, *values = line.split()
        if case[1] and method != "ransac":
            continue  # made for bearings that are all right
        numbers = np.array(values, dtype=np.float64)
        theirs = numbers[:9].reshape(3, 3), numbers[9:]
        scores.setdefault(NAMES[method], Score()).add(drawn[int(number)], theirs, float(taken_there))
    return scores


def rows(program: Path, two_views: bool, scenes: int) -> Iterator[str]:
    """Yield the lines of one table, and which of our quantiles are worse than OpenGV's."""
    worse = []
    for noise in NOISES_PX:
        for case in MATCHES if two_views else POINTS:
            scores = compare(program, case, noise, two_views, scenes)
            for name, score in scores.items():
                yield _row(f"{noise} | {case[0]} | {100 * case[1]:.0f}% | {name}", score, scenes)
            worse += [f"{noise} px, {case[0]}, {100 * case[1]:.0f}% wrong: {what}" for what in _worse(scores)]
    yield ""
    yield f"Ours surely worse than one of OpenGV's: {'; '.join(worse) or 'nowhere'}."


def _worse(scores: dict[str, Score]) -> Iterator[str]:
    """Yield which of our quantiles are larger than OpenGV's, and not by chance: a paired bootstrap."""
    random = np.random.default_rng(0)
    for name, theirs in scores.items():
        if name in (OURS, OURS_OK):
            continue
        for what in ("rotation", "place"):
            pair = [np.array(getattr(score, what)) for score in (scores[OURS], theirs)]
            drawn = random.integers(0, len(pair[0]), (RESAMPLINGS, len(pair[0])))
            for percent in (50, 90):
                ours_there, there = (np.percentile(values[drawn], percent, axis=1) for values in pair)
                if (ours_there > there).mean() >= SURE:
                    yield f"{what}, {'median' if percent == 50 else 'p90'}, {name}"


def _row(head: str, score: Score, scenes: int) -> str:
    turn, place = np.array(score.rotation), np.array(score.place)
    if not len(turn):
        return f"| {head} | – | – | – | 0% | – |"
    cells = [
        f"{np.median(turn):.3f} / {np.percentile(turn, 90):.3f}",
        f"{np.median(place):.2f} / {np.percentile(place, 90):.2f}",
        f"{100 * np.mean(turn > GROSS_DEGREES):.1f}%",
        f"{100 * len(turn) / scenes:.0f}%",
        f"{np.median(score.microseconds):.0f}",
    ]
    return f"| {head} | " + " | ".join(cells) + " |"


def lines(scenes: int) -> Iterator[str]:
    """Yield both tables; or why there are none."""
    with tempfile.TemporaryDirectory() as folder:
        program = built(Path(folder))
        if isinstance(program, str):
            yield f"Not run: {program}."
            return
        for two_views in (True, False):
            kind, what = ("Two images", "matches") if two_views else ("Known points", "points")
            unit = "direction, median / p90 [deg]" if two_views else "place, median / p90 [% of distance]"
            yield f"{kind}, {scenes} scenes a case:"
            yield ""
            yield f"| noise [px] | {what} | wrong | | rotation, median / p90 [deg] | {unit} |" \
                " rotation > 10° | answered | µs |"  # fmt: skip
            yield "|---" * 9 + "|"
            yield from rows(program, two_views, scenes)
            yield ""


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=200)
    for line in lines(parser.parse_args().scenes):
        print(line, flush=True)


if __name__ == "__main__":
    main()
