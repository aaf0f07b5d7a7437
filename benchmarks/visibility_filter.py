"""The visibility filter: the time of a step, and what it saves where the plan is wrong on purpose.

Run: ``python -m benchmarks.visibility_filter [RUNS] [JOBS]``. A scene: 12 points in a box of 0.30 m, 0.35 to
0.65 m away, at least `END_ROOM_PX` inside the image from either end of a random motion; perspective camera
and fisheye in turn. It is *recoverable* where the planner certifies a path between these two poses that keeps
every point `PATH_ROOM_PX` inside the image: whether the filter succeeds has no part in it. The plan that is
followed is another one, wrong on purpose: its camera is off by 2% and 3 px (and states so many px as its
deviation), its points by 5% of scale and 2% each, its goal by 10% and 2°, and its path is bent aside, farther
and farther until `PathTracker`, which follows it by the image, loses a point if nobody stops it. Counted are
the recoverable scenes where it does. What is stated as the camera's deviation keeps points some 10 px inside,
whatever else the filter does; so all is done again with the true camera, where `visibility_margin` is all
that there is.

The loop: projected pixels with 0.5 px of noise at 30 frames a second, a twist acting 20 ms after the
exposure, the camera moving exactly as told; tracker and filter know the wrong camera and the wrong points
alone, the filter has its default options. A point is kept where its true projection is in the image at every
frame;
the goal is reached within `REACHED_PX` rms of the goal image.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from benchmarks.estimation_speed import random_scene
from benchmarks.stopwatch import shortest
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath, Plan, PlanningProblem, plan_path
from omniservo.reporting.image_distance import image_distance
from omniservo.safety import SafetyOptions, VisibilityFilter
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import PathTracker, TrackerOptions

POINTS, NOISE_PX = 12, 0.5
END_ROOM_PX, PATH_ROOM_PX, REACHED_PX = 20.0, 5.0, 4.0
PERIOD, LATENCY, SECONDS, PATH_SECONDS = 1.0 / 30.0, 0.02, 8.0, 4.0
BENDS = (0.15, 0.3, 0.5)
"""How far a path is bent aside, in turn: [m], and twice as many [rad]."""

OPTIONS = SafetyOptions()
CAMERAS = (UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480), preset("fe185"))


@dataclass(frozen=True)
class WrongPlan:
    """A recoverable scene with a plan that is wrong."""

    camera: UnifiedCamera
    """true"""
    believed: UnifiedCamera
    points: FloatArray
    """true, (12, 3)"""
    goal: RigidTransform
    """true"""
    plan: Plan
    """wrong"""


@dataclass(frozen=True)
class Followed:
    """What became of a run."""

    kept: bool
    """no point ever left the image"""
    reached: bool
    """the goal image was met"""
    stopped: bool
    """the tracker stopped with a named error"""
    beyond: float
    """how far the worst point got out of the image, by its limits [px]; 0 where kept"""


def wrong_plan(seed: int, *, true_camera: bool) -> WrongPlan | None:
    """Return a recoverable scene with a plan on which a point is lost; None where this seed gives none."""
    rng, camera = np.random.default_rng([608, seed]), CAMERAS[seed % len(CAMERAS)]
    scene = random_scene(rng, camera, POINTS, 0.0)
    goal, points = scene.initial_T_goal, scene.points
    ends = (points, goal.inv().apply(points))
    if min(_room(camera, c) for c in ends) < END_ROOM_PX:
        return None
    asked = PlanningProblem(camera, points, goal, least_distance=0.1, visibility_margin=PATH_ROOM_PX)
    if plan_path(asked, seed=seed).status != "certified":
        return None
    f, c = 1.0 + 0.02 * rng.choice([-1.0, 1.0]), 3.0 * rng.choice([-1.0, 1.0], 2)
    believed = camera if true_camera else wrong_camera(camera, f, c)
    guessed = points * (1.0 + 0.05 * rng.choice([-1.0, 1.0])) * (1.0 + 0.02 * rng.normal(size=(POINTS, 1)))
    turn = Rotation.from_rotvec(np.deg2rad(2.0) * _direction(rng))
    missed = RigidTransform.from_components(1.1 * np.asarray(goal.translation), goal.rotation * turn)
    problem = PlanningProblem(believed, guessed, missed, least_distance=1e-3)
    aside, about = _direction(rng), _direction(rng)
    for bend in BENDS:
        plan = Plan(
            problem, "not_found", bent(missed, bend * aside, 2.0 * bend * about), None, 0.0, "certified"
        )
        case = WrongPlan(camera, believed, points, goal, plan)
        if not follow(case, seed, filtered=False).kept:
            return case
    return None


def wrong_camera(camera: UnifiedCamera, focal: float, centre: FloatArray) -> UnifiedCamera:
    """Return the camera with its focal lengths times ``focal``, its centre moved [px], which it states."""
    fields = camera.to_dict()
    fields |= {"fx": focal * camera.fx, "fy": focal * camera.fy}
    fields |= {"cx": camera.cx + centre[0], "cy": camera.cy + centre[1]}
    fields |= {"deviation_px": 0.5 * abs(focal - 1.0) * camera.width + float(np.linalg.norm(centre))}
    return UnifiedCamera.from_dict(fields)


def bent(goal: RigidTransform, aside: FloatArray, about: FloatArray) -> CameraPath:
    """Return a path of degree 2 to the goal that is bent aside [m] and turned about [rad] in its middle."""
    end = goal.rotation.as_quat()
    end = end if end[3] >= 0 else -end
    start, bow = np.array([0.0, 0.0, 0.0, 1.0]), 4.0 * np.append(0.5 * about, 0.0)
    shift, way = 4.0 * aside, np.asarray(goal.translation)
    return CameraPath(
        np.column_stack([-bow, end - start + bow, start]), np.column_stack([-shift, way + shift, np.zeros(3)])
    )


def follow(case: WrongPlan, seed: int, *, filtered: bool) -> Followed:
    """Follow the wrong plan in closed loop; without the filter it ends where a point is lost."""
    rng, camera = np.random.default_rng([7, seed]), case.camera
    goal_pixels, _ = camera.project(case.goal.inv().apply(case.points))
    options = TrackerOptions(delay=LATENCY + 0.5 * PERIOD, divergence_px=1e6, tolerance_px=2.0)
    tracker = PathTracker(
        case.plan,
        case.believed,
        goal_pixels=goal_pixels,
        options=options,
        time_law=RestToRestLaw(PATH_SECONDS),
    )
    visibility = VisibilityFilter(case.believed, delay=LATENCY, options=OPTIONS)
    rotation, centre, twist = np.eye(3), np.zeros(3), np.zeros(6)
    stopped, least = False, math.inf
    for k in range(round(SECONDS / PERIOD)):
        pixels, valid = camera.project((case.points - centre) @ rotation)
        seen = pixels + NOISE_PX * rng.standard_normal(pixels.shape)
        valid &= camera.in_image(np.where(valid[:, None], pixels, -1e6))
        last = twist
        try:
            twist = tracker.step(k * PERIOD, np.where(valid[:, None], seen, 0.0), valid)
            if filtered:
                twist = visibility.step(_believed(tracker), seen, valid, twist).twist
        except ServoStop:
            stopped = True
            break
        for acting, time in ((last, LATENCY), (twist, PERIOD - LATENCY)):
            centre = centre + rotation @ _turned(0.5 * time * acting[3:]) @ acting[:3] * time
            rotation = rotation @ _turned(time * acting[3:])
        least = min(least, _room(camera, (case.points - centre) @ rotation))
        if tracker.done or (least < 0.0 and not filtered):
            break
    final, valid = camera.project((case.points - centre) @ rotation)
    error = math.sqrt(np.mean(np.sum((final - goal_pixels) ** 2, axis=1))) if valid.all() else math.inf
    return Followed(least >= 0.0, least >= 0.0 and error < REACHED_PX, stopped, max(0.0, -least))


def _believed(tracker: PathTracker) -> FloatArray:
    """Return the points in the camera frame, as the tracker's last step has them."""
    assert tracker.report is not None
    pose = tracker.report.pose
    return np.asarray((tracker.points - pose[4:]) @ Rotation.from_quat(pose[:4]).as_matrix())


def _turned(vector: FloatArray) -> FloatArray:
    return Rotation.from_rotvec(vector).as_matrix()


def _room(camera: UnifiedCamera, points: FloatArray) -> float:
    """Return the least distance of points (n, 3) in the camera frame to an image limit [px]."""
    pixels, valid = camera.project(points)
    return float(image_distance(camera, pixels).min()) if valid.all() else -100.0


def _direction(rng: np.random.Generator) -> FloatArray:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _run(seed: int, true_camera: bool) -> Followed | None:
    case = wrong_plan(seed, true_camera=true_camera)
    return None if case is None else follow(case, seed, filtered=True)


def outcomes(runs: int, jobs: int, *, true_camera: bool) -> list[Followed]:
    """Return what becomes of the first so many recoverable scenes with a plan that loses points."""
    found: list[Followed] = []
    run = partial(_run, true_camera=true_camera)
    with ProcessPoolExecutor(jobs) as pool:
        for first in range(0, 100 * runs, 200):
            found += [o for o in pool.map(run, range(first, first + 200), chunksize=10) if o is not None]
            if len(found) >= runs:
                break
    return found[:runs]


def step_microseconds(count: int, *, held: bool) -> tuple[float, float]:
    """Return the shortest times of a public step for ``count`` points [µs]: of ours, and of SciPy's SLSQP.

    Args:
        count: points.
        held: whether the command would lose points, so that the program must be solved; else all rows hold.
    """
    rng, camera = np.random.default_rng(1), CAMERAS[0]
    pixels = rng.uniform([4, 4], [635, 475], (count, 2))
    bearings, valid = camera.unproject(pixels)
    points = bearings * rng.uniform(0.4, 0.6, (count, 1))
    wanted = np.array([0.3, -0.2, 0.5, 0.5, -0.4, 0.6]) * (1.0 if held else 1e-4)
    visibility = VisibilityFilter(camera, options=OPTIONS)
    ours = min(shortest(lambda: visibility.step(points, pixels, valid, wanted), 50) for _ in range(20))
    rows, least = _rows(camera, points)
    weight = np.array([1.0 / np.linalg.norm(points, axis=1).mean()] * 3 + [1.0] * 3)

    def peer() -> object:
        return minimize(
            lambda v: np.sum((weight * (v - wanted)) ** 2),
            np.zeros(6),
            jac=lambda v: 2.0 * weight**2 * (v - wanted),
            constraints={"type": "ineq", "fun": lambda v: rows @ v - least, "jac": lambda v: rows},
            method="SLSQP",
        )

    return ours, shortest(peer, 20)


def _rows(camera: UnifiedCamera, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rows and right sides of the edges' inequalities, from the camera's own derivatives."""
    pixels, slope, _ = camera.project_jacobian(points)
    across = np.array([[[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]] for x, y, z in points])
    flow = slope @ np.concatenate(
        [-np.broadcast_to(np.eye(3), across.shape), -across.transpose(0, 2, 1)], axis=2
    )
    size, margin = np.array([camera.width, camera.height]), OPTIONS.visibility_margin
    heights = np.concatenate([pixels + 0.5 - margin, size - 0.5 - margin - pixels]).ravel()
    return np.concatenate([flow, -flow]).reshape(-1, 6), -OPTIONS.visibility_rate * heights


def lines(runs: int = 1000, jobs: int = 2) -> Iterator[str]:
    """Measure everything and say it."""
    for count in (9, 20, 50):
        for held, words in ((False, "command passes"), (True, "command held back")):
            ours, peer = step_microseconds(count, held=held)
            yield f"{count} points, {words}: {ours:.1f} us a step; SciPy's SLSQP {peer / ours:.0f} times that"
    for true_camera, camera in ((False, "a wrong camera"), (True, "the true camera")):
        found = outcomes(runs, jobs, true_camera=true_camera)
        kept, reached = sum(o.kept for o in found), sum(o.reached for o in found)
        stopped, worst = sum(o.stopped for o in found), max(o.beyond for o in found)
        yield (
            f"{len(found)} recoverable runs with {camera} on which the plan alone loses points: with the "
            f"filter {kept} ({100 * kept / len(found):.1f}%) keep every point, {reached} reach the goal, "
            f"{stopped} stopped by name; worst {worst:.2f} px out"
        )


def main() -> None:
    """Print the figures; the arguments are RUNS and JOBS."""
    for line in lines(*(int(a) for a in sys.argv[1:3])):
        print(line, flush=True)


if __name__ == "__main__":
    main()
