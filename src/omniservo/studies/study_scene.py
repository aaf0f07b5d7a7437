"""One scene of a study: what is true, and how wrong what is given is."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models import CentralModel
from omniservo.cameras.widest_angle import widest_angle
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.planning import PlanningProblem, Sphere
from omniservo.scenes import LensError
from omniservo.studies.placed_arm import MountError, PlacedArm, placed_arm
from omniservo.studies.study import Study
from omniservo.studies.study_arms import NO_ARM

LEAST_DISTANCE = 0.03
"""[m] that plans keep to the points"""

_TRIES = 200
_OBSTACLE_TRIES = 50
_IMAGE_MARGIN = 10.0
"""[px] that the points keep to the image's limits at both ends"""
_END_ROOM = 0.02
"""[m] that obstacles keep beyond the clearance at both ends, and beyond their surface to the points"""
_FIELD_LENGTH = 0.2
"""over which the camera model's error is alike, of the image's width"""


@dataclass(frozen=True)
class Conditions:
    """What was drawn for a scene beside its geometry; fields as in the study file."""

    noise: float
    lost: float
    wrong: float
    latency: float
    jitter: float
    dropped: float
    delayed: float
    delay: float
    model: float
    focal: float
    centre: tuple[float, float]
    depth: float


@dataclass(frozen=True)
class Geometry:
    """What was drawn of start and target."""

    points: int
    size: float
    distance: float
    goal_off_axis: float
    rotation: float
    distance_ratio: float
    start_off_axis: float
    obstacles: int


@dataclass(frozen=True, eq=False)
class MovedObstacles:
    """Balls of which one was put elsewhere."""

    time: float
    """when that is: an image is taken then [s]"""
    obstacles: tuple[Sphere, ...]
    """all of them, from then on"""


@dataclass(frozen=True, eq=False)
class StudyScene:
    """A camera that is to be led to the goal; everything in the initial camera frame."""

    number: int
    camera: CentralModel
    """as it is stated to the methods"""
    lens: LensError | None
    """what its model is off"""
    drawn: Geometry
    conditions: Conditions
    points: FloatArray
    """(n, 3) [m]"""
    initial_T_goal: RigidTransform
    obstacles: tuple[Sphere, ...]
    clearance: float
    """the camera's own radius [m]"""
    arm: PlacedArm | None = None
    """what carries the camera; None: it moves freely"""
    moved: MovedObstacles | None = None
    """None: the balls stay where they are"""

    @property
    def after_move(self) -> StudyScene:
        """The scene once the ball was put elsewhere, if one is."""
        return self if self.moved is None else replace(self, obstacles=self.moved.obstacles, moved=None)

    def phases(self, times: list[float]) -> list[tuple[slice, tuple[Sphere, ...]]]:
        """Return which of the times (k,) [s] belong to which obstacles; that of a move belongs to both."""
        if self.moved is None or times[-1] < self.moved.time:
            return [(slice(None), self.obstacles)]
        k = bisect_left(times, self.moved.time)
        return [(slice(0, k + 1), self.obstacles), (slice(k, None), self.moved.obstacles)]

    def shown(self, points: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return where points (n, 3) in the camera frame are truly seen, (n, 2) [px], and which are (n,)."""
        return _shown(self.camera, self.lens, self.conditions, points)

    def hidden(self, points: FloatArray, centre: FloatArray) -> BoolArray:
        """Return which points (n, 3) an obstacle hides from a camera's ``centre`` (3,)."""
        middles, squared_radii = self._balls
        ray, to_ball = points - centre, middles - centre
        squared, shared = (ray * ray).sum(axis=1)[:, None], ray @ to_ball.T
        along = np.minimum(np.maximum(shared / squared, 0.0), 1.0)
        off = along * (along * squared - 2.0 * shared) + (to_ball * to_ball).sum(axis=1)
        behind: BoolArray = np.logical_or.reduce(off < squared_radii, axis=1)
        return behind

    @cached_property
    def _balls(self) -> tuple[FloatArray, FloatArray]:
        """Middles (b, 3) [m] and squared radii (b,) [m²] of the obstacles."""
        middles = np.array([ball.center for ball in self.obstacles]).reshape(-1, 3)
        return middles, np.array([ball.radius for ball in self.obstacles]) ** 2


class NoScene(Exception):
    """No scene was found in which both ends see the whole target."""


def generators(study: Study, scene: int) -> tuple[np.random.Generator, np.random.Generator]:
    """Return what draws the scene, and what draws its images: alike for all methods, on every machine."""
    geometry, images, *_ = _generators(study, scene)
    return geometry, images


def _generators(study: Study, scene: int) -> list[np.random.Generator]:
    """Return what draws the scene, its images, its arm and a move: none of these changes the others."""
    seeds = np.random.SeedSequence(study.seed, spawn_key=(scene,)).spawn(4)
    return [np.random.Generator(np.random.PCG64(seed)) for seed in seeds]


def draw_scene(study: Study, number: int, camera: CentralModel) -> StudyScene:
    """Return scene ``number`` of the study.

    Its numbers are drawn once. Directions and points are drawn until both ends see all points, 10 px within
    the image's limits, and the arm, if there is one, can stand at both; so the numbers keep their stated
    distributions where every combination has a scene.

    Raises:
        NoScene: 200 tries found none.
    """
    random, _, of_arm, of_move = _generators(study, number)
    conditions, drawn = _drawn(study, camera, random)
    name = study.arms.draw(of_arm)
    error = MountError(study.errors.mount_translation.draw(of_arm), study.errors.mount_rotation.draw(of_arm))
    lens = _lens(study, number, camera, conditions)
    for _ in range(_TRIES):
        points, goal = _ends(drawn, random)
        ends = points, goal.inv().apply(points)
        if not all(_well_inside(camera, *_shown(camera, lens, conditions, end)) for end in ends):
            continue
        obstacles = _placed(study, drawn, points, goal, random)
        clearance = study.obstacles.clearance
        scene = StudyScene(
            number, camera, lens, drawn, conditions, points, goal, obstacles, clearance,
            moved=_moved(study, points, goal, obstacles, of_move),
        )  # fmt: skip
        if name == NO_ARM:
            return scene
        arm = placed_arm(
            name, study.arms.mounts[name], error, problem_of_truth(scene),
            study.servo.clearance_margin, of_arm,
        )  # fmt: skip
        if arm is not None:
            return replace(scene, arm=arm)
    without = "" if name == NO_ARM else f", or {name} cannot stand at both"
    raise NoScene(
        f"no scene in {_TRIES} tries: turned by {math.degrees(drawn.rotation):.1f} deg at "
        f"{drawn.distance_ratio:.2f} times the distance, an end does not see all points{without}"
    )


def _lens(study: Study, number: int, camera: CentralModel, conditions: Conditions) -> LensError | None:
    """Return what the camera's model is off in this scene: of another seed it is another field."""
    if not conditions.model:
        return None
    seed = np.random.SeedSequence(study.seed, spawn_key=(number,)).generate_state(1, np.uint64)
    return LensError(conditions.model, _FIELD_LENGTH * camera.width, int(seed[0]))


def problem_of_truth(scene: StudyScene) -> PlanningProblem:
    """Return what a camera has to keep in a scene if everything is known exactly: what is scored, and sight.

    It says whether a scene has a solution at all; no method is given it.
    """
    return PlanningProblem(
        scene.camera,  # type: ignore[arg-type]  # of any model
        scene.points, scene.initial_T_goal, scene.obstacles, clearance=scene.clearance,
        least_distance=LEAST_DISTANCE, occlusion=bool(scene.obstacles),
    )  # fmt: skip


def _drawn(study: Study, camera: CentralModel, random: np.random.Generator) -> tuple[Conditions, Geometry]:
    images, errors, target, start = study.images, study.errors, study.target, study.start
    conditions = Conditions(
        noise=images.noise.draw(random),
        lost=images.lost.draw(random),
        wrong=images.wrong.draw(random),
        latency=images.latency.draw(random),
        jitter=images.jitter.draw(random),
        dropped=images.dropped.draw(random),
        delayed=images.delayed.draw(random),
        delay=images.delay.draw(random),
        model=errors.model.draw(random),
        focal=errors.focal.draw(random),
        centre=(errors.centre.draw(random), errors.centre.draw(random)),
        depth=errors.depth.draw(random),
    )
    points, size, distance = (
        int(target.points.draw(random)),
        target.size.draw(random),
        target.distance.draw(random),
    )
    goal_off_axis = (target.view_share or target.off_axis).draw(random)
    rotation, ratio = start.rotation.draw(random), start.distance_ratio.draw(random)
    start_off_axis = (start.view_share or start.off_axis).draw(random)
    if target.view_share:
        goal_off_axis *= _farthest_off_axis(camera, size, distance)
    if start.view_share:
        start_off_axis *= _farthest_off_axis(camera, size, ratio * distance)
    obstacles = int(study.obstacles.count.draw(random))
    geometry = Geometry(points, size, distance, goal_off_axis, rotation, ratio, start_off_axis, obstacles)
    return conditions, geometry


def _farthest_off_axis(camera: CentralModel, size: float, distance: float) -> float:
    """Return how far from the axis a cube's middle may be for all of the cube to be in the image [rad]."""
    corner = 0.5 * math.sqrt(3.0) * size
    half = math.asin(min(corner / max(distance, 1e-9), 1.0))
    return max(widest_angle(camera) - half, 0.0)


def _ends(drawn: Geometry, random: np.random.Generator) -> tuple[FloatArray, RigidTransform]:
    """Return points and goal in the initial camera frame; both cameras see the cube's middle as drawn."""
    goal_middle = drawn.distance * _off_axis(drawn.goal_off_axis, random)
    initial_middle = drawn.distance_ratio * drawn.distance * _off_axis(drawn.start_off_axis, random)
    axis = random.standard_normal(3)
    turn = Rotation.from_rotvec(drawn.rotation * axis / np.linalg.norm(axis))
    initial_T_goal = RigidTransform.from_components(initial_middle - turn.apply(goal_middle), turn)
    cube = drawn.size * random.uniform(-0.5, 0.5, (drawn.points, 3))
    return initial_middle + cube, initial_T_goal


def _off_axis(angle: float, random: np.random.Generator) -> FloatArray:
    round_axis = random.uniform(0.0, 2.0 * math.pi)
    across = math.sin(angle)
    return np.array([across * math.cos(round_axis), across * math.sin(round_axis), math.cos(angle)])


def _shown(
    camera: CentralModel, lens: LensError | None, conditions: Conditions, points: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return where the true camera, which is not quite the stated one, shows points."""
    pixels, valid = camera.project(points)
    if lens is not None:
        pixels = pixels + lens.at(pixels)
    if conditions.focal or any(conditions.centre):
        middle = 0.5 * np.array([camera.width - 1.0, camera.height - 1.0])
        pixels = middle + (1.0 + conditions.focal) * (pixels - middle) + conditions.centre
    return pixels, valid & camera.in_image(pixels)


def _well_inside(camera: CentralModel, pixels: FloatArray, seen: BoolArray) -> bool:
    if not seen.all():
        return False
    shifts = _IMAGE_MARGIN * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    return bool(camera.in_image((pixels[:, None] + shifts).reshape(-1, 2)).all())


def _placed(
    study: Study, drawn: Geometry, points: FloatArray, goal: RigidTransform, random: np.random.Generator
) -> tuple[Sphere, ...]:
    """Return balls across the straight line, clear of both ends and of what these see of the points."""
    end, found = np.array(goal.translation), []
    for _ in range(drawn.obstacles):
        ball = _near_line(study, study.obstacles.radius.draw(random), points, end, random, (0.3, 0.7))
        if ball is not None:
            found.append(ball)
    return tuple(found)


def _near_line(
    study: Study,
    radius: float,
    points: FloatArray,
    end: FloatArray,
    random: np.random.Generator,
    part: tuple[float, float],
) -> Sphere | None:
    """Return a ball near a part of the line to the end, clear as `_placed` says; None: none is found."""
    free = radius + study.obstacles.clearance + study.servo.clearance_margin + _END_ROOM
    aside = study.obstacles.aside * float(np.linalg.norm(end))
    for _ in range(_OBSTACLE_TRIES):
        middle = random.uniform(*part) * end + aside * random.standard_normal(3)
        clear = min(np.linalg.norm(middle), np.linalg.norm(middle - end)) > free
        if clear and not _hides(middle, radius + _END_ROOM, points, end):
            return Sphere(middle, radius)
    return None


def _moved(
    study: Study,
    points: FloatArray,
    goal: RigidTransform,
    obstacles: tuple[Sphere, ...],
    random: np.random.Generator,
) -> MovedObstacles | None:
    """Return the balls with one of them elsewhere; None: all stay."""
    chance, time = study.obstacles.moved.draw(random), study.obstacles.moved_at.draw(random)
    if not obstacles or float(random.random()) >= chance:
        return None
    which, end = int(random.integers(len(obstacles))), np.array(goal.translation)
    ball = _near_line(study, obstacles[which].radius, points, end, random, (0.5, 0.8))
    if ball is None:
        return None
    period = 1.0 / study.images.rate
    there = (*obstacles[:which], ball, *obstacles[which + 1 :])
    return MovedObstacles(math.ceil(time / period) * period, there)


def _hides(middle: FloatArray, radius: float, points: FloatArray, end: FloatArray) -> bool:
    """Return whether a ball lies before or in a point, for the camera at the start or at the ``end``."""
    for centre in (np.zeros(3), end):
        ray = points - centre
        along = np.clip((ray @ (middle - centre)) / (ray**2).sum(axis=1), 0.0, 1.0)
        if (np.linalg.norm(centre + along[:, None] * ray - middle, axis=1) < radius).any():
            return True
    return False
