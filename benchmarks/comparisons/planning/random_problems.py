"""The generators of the random sets. Their numbers are published here: a change changes the checksums.

Every problem: nine target points in a cube of 0.16 m, 0.4 to 0.9 m away; a goal 0.1 m or more away that sees
them all; obstacles where the straight path goes. Both end poses keep everything with a little to spare.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from benchmarks.comparisons.planning.draws import Draws
from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.pose_check import pose_values
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Box, Degrees, PlanningProblem, Sphere

FISHEYE_220 = UnifiedCamera(510, 510, 511.5, 511.5, 1.291, 1024, 1024, max_angle=math.radians(110.0))
"""A lens of 220° that fills a square image."""

SPARE = 2e-3
"""What both end poses keep at least, in the units of `samples`."""

Obstacles = tuple[Sphere | Box, ...]


def points_across(draws: Draws, points: FloatArray, t: FloatArray) -> tuple[Obstacles, float]:
    """One to three points near the straight line; the clearance is 0.2 to 0.35 of its length."""
    length = float(np.linalg.norm(t))
    count, clearance = draws.whole(1, 3), draws.number(0.2, 0.35) * length
    near = [draws.number(0.3, 0.7) * t + _noise(draws, 0.12 * length) for _ in range(count)]
    return tuple(Sphere(center) for center in near), clearance


def occluders(draws: Draws, points: FloatArray, t: FloatArray) -> tuple[Obstacles, float]:
    """Two to five balls of 10 to 30 mm between the straight line and a target point."""
    found = []
    for _ in range(draws.whole(2, 5)):
        eye = draws.number(0.2, 0.8) * t
        center = eye + (points[draws.whole(0, len(points) - 1)] - eye) * draws.number(0.2, 0.7)
        found.append(Sphere(center + _noise(draws, 0.02), draws.number(0.01, 0.03)))
    return tuple(found), 0.01


def box_clutter(draws: Draws, points: FloatArray, t: FloatArray) -> tuple[Obstacles, float]:
    """Six to fifteen boxes with edges of 40 to 160 mm around the straight line, the first one across it."""
    along, found = t / np.linalg.norm(t), []
    for k in range(draws.whole(6, 15)):
        at, aside = (draws.number(0.3, 0.7), 0.03) if k == 0 else (draws.number(-0.2, 1.2), 0.2)
        center = at * t + draws.number(0.0, aside) * draws.across(along)
        found.append(Box(center, draws.numbers(0.02, 0.08, 3), draws.turn(180.0).as_quat()))
    return tuple(found), 0.02


def wall_with_hole(draws: Draws, points: FloatArray, t: FloatArray) -> tuple[Obstacles, float]:
    """21 × 21 balls of 20 mm, 45 mm apart, across the middle of the way; about eleven are left out.

    With the clearance of 20 mm nothing but the hole lets the camera through.
    """
    tilted = draws.turn(15.0).apply(t / np.linalg.norm(t))
    first = draws.across(tilted)
    second = np.cross(tilted, first)
    around, away = draws.number(0.0, 2.0 * math.pi), draws.number(0.1, 0.22)
    hole = away * np.array([math.cos(around), math.sin(around)])
    places = 0.045 * np.stack(np.meshgrid(np.arange(-10, 11), np.arange(-10, 11)), axis=-1).reshape(-1, 2)
    solid = places[np.linalg.norm(places - hole, axis=1) > 0.085]
    return tuple(Sphere(0.5 * t + a * first + b * second, 0.02) for a, b in solid), 0.02


def _noise(draws: Draws, size: float) -> FloatArray:
    """Return a vector of random direction, 0 to twice ``size`` long."""
    return draws.number(0.0, 2.0 * size) * draws.direction()


@dataclass(frozen=True)
class Kind:
    """What the problems of a set have in common."""

    cameras: tuple[UnifiedCamera, ...]
    """by turns"""
    angle: tuple[float, float]
    """of the target's middle from the optical axis at the start [deg]"""
    turn: float
    """the goal's rotation at most [deg]"""
    obstacles: Callable[[Draws, FloatArray, FloatArray], tuple[Obstacles, float]] = points_across
    way: tuple[float, float] = (0.1, 0.45)
    """length of the goal's translation [m]"""
    about_axis: bool = False
    """the goal turns about the optical axis, up to ``turn``, and little about others"""
    past: float = 0.0
    """a target point is so far from the axis at the start or at the goal [deg]"""
    occlusion: bool = False
    degrees: Degrees = field(default=Degrees(3, 3))


KINDS = MappingProxyType(
    {
        "fisheye": Kind((preset("fe185"),), (0.0, 68.0), 90.0),
        "perspective": Kind((preset("perspective"),), (0.0, 17.0), 60.0),
        "catadioptric": Kind((preset("para-catadioptric"),), (12.0, 90.0), 180.0, about_axis=True),
        "occlusion": Kind((preset("fe185"),), (0.0, 45.0), 60.0, occluders, occlusion=True),
        "past-90": Kind(
            (FISHEYE_220, preset("hyper-catadioptric"), preset("para-catadioptric")),
            (75.0, 100.0),
            90.0,
            past=92.0,
        ),
        "boxes": Kind(
            (preset("fe185"),), (0.0, 57.0), 60.0, box_clutter, way=(0.3, 0.6), degrees=Degrees(4, 4)
        ),
        "wall": Kind((preset("fe185"),), (0.0, 57.0), 45.0, wall_with_hole, way=(0.3, 0.45)),
    }
)
"""Name → kind."""


def random_problem(name: str, index: int) -> PlanningProblem:
    """Return problem ``index`` of a random set: always the same, whatever was drawn before."""
    kind, draws = KINDS[name], Draws(name, index)
    camera = kind.cameras[index % len(kind.cameras)]
    while True:
        scene = _target_and_goal(kind, camera, draws)
        if scene is None:
            continue
        points, goal = scene
        for _ in range(40):
            obstacles, clearance = kind.obstacles(draws, points, goal.translation)
            problem = PlanningProblem(
                camera,
                points,
                goal,
                obstacles,
                clearance=clearance,
                least_distance=0.03,
                visibility_margin=1.0,
                occlusion=kind.occlusion,
                degrees=kind.degrees,
            )
            if ends_are_good(problem):
                return problem


def _target_and_goal(
    kind: Kind, camera: UnifiedCamera, draws: Draws
) -> tuple[FloatArray, RigidTransform] | None:
    """Return target points visible from the start, and a goal that sees them; None where a draw has none."""
    angle, around = math.radians(draws.number(*kind.angle)), draws.number(0.0, 2.0 * math.pi)
    toward = [math.sin(angle) * math.cos(around), math.sin(angle) * math.sin(around), math.cos(angle)]
    points = np.array(toward) * draws.number(0.4, 0.9) + draws.numbers(-0.08, 0.08, 9, 3)
    if not _sees(camera, points, RigidTransform.identity()):
        return None
    for _ in range(100):
        goal = RigidTransform.from_components(draws.number(*kind.way) * draws.direction(), _turn(kind, draws))
        if _sees(camera, points, goal) and _is_far_enough_out(kind, points, goal):
            return points, goal
    return None


def _turn(kind: Kind, draws: Draws) -> Rotation:
    if not kind.about_axis:
        return draws.turn(kind.turn)
    spin = math.radians(draws.number(-kind.turn, kind.turn))
    return Rotation.from_rotvec([0.0, 0.0, spin]) * draws.turn(30.0)


def _sees(camera: UnifiedCamera, points: FloatArray, pose: RigidTransform) -> bool:
    return ends_are_good(
        PlanningProblem(camera, pose.inv().apply(points), RigidTransform.identity(), visibility_margin=5.0)
    )


def _is_far_enough_out(kind: Kind, points: FloatArray, goal: RigidTransform) -> bool:
    seen = np.concatenate([points, goal.inv().apply(points)])
    angles = np.degrees(np.arctan2(np.hypot(seen[:, 0], seen[:, 1]), seen[:, 2]))
    return bool(angles.max() >= kind.past)


def ends_are_good(problem: PlanningProblem) -> bool:
    """Tell whether both end poses keep everything, with `SPARE`."""
    neutral, identity = neutral_of(problem), np.array([0.0, 0.0, 0.0, 1.0])
    least = np.full(5, np.inf)
    worst = pose_values(neutral, identity, np.zeros(3), least)
    return min(worst, pose_values(neutral, neutral.quaternion, neutral.translation, least)) > SPARE
