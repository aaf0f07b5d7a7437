"""Problems that more than one file plans."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.planning import CameraPath, PlanningProblem, Sphere
from omniservo.planning.end_poses import violation_at_end

sys.path.insert(0, str(Path(__file__).parent))  # importlib mode adds no folder: solids.py

CAMERAS = {
    "fisheye": ("fe185", 1.2, 90.0),
    "pinhole": ("perspective", 0.3, 60.0),
    "catadioptric": ("para-catadioptric", 2.0, 180.0),
    "occlusion": ("fe185", 0.6, 60.0),
}
"""kind: preset, largest angle of the target from the axis [rad], largest rotation [deg]"""


def grid(center: list[float], spacing: list[float], depth: float) -> np.ndarray:
    """The paper's nine dots: two boards that meet at a ridge (docs/paper-scenes.md)."""
    return np.array(
        [
            [
                center[0] + i * spacing[0],
                center[1] + k * spacing[1],
                center[2] - abs(i) * depth + (0.004 if (i + k) % 2 == 0 else -0.004),
            ]
            for k in (-1, 0, 1)
            for i in (-1, 0, 1)
        ]
    )


def paper_problem(example: int, **changes: object) -> PlanningProblem:
    """Example 1 or 2 of the paper, or 3: example 2 with the box as spheres that hide dots."""
    fields: dict[str, object] = {"visibility_margin": 2.0, "least_distance": 0.02}
    if example == 1:
        points = grid([0.0, -0.08, 0.40], [0.08, 0.06], 0.07)
        translation, turn = [0.0497, -99.9782, 199.9552], [-0.0030, 0.0013, -0.0015]
        obstacles = (Sphere([-0.010, -0.065, 0.085]), Sphere([-0.005, -0.080, 0.090]))
        fields["clearance"] = 0.055
    else:
        points = grid([-0.12, 0.02, 0.36], [0.07, 0.05], 0.04)
        translation, turn = [-202.0935, 0.0154, -8.2329], [-0.0111, -24.9738, 0.0056]
        obstacles = (Sphere([-0.098, -0.002, 0.040]),)
        fields["clearance"] = 0.070
    if example == 3:
        box = [Sphere([-0.098, -0.002, z], 0.0237, 0.0) for z in (0.004, 0.022, 0.040, 0.058, 0.076)]
        obstacles = (*obstacles, *box)
        fields |= {"clearance": 0.080, "occlusion": True}
    goal = RigidTransform.from_components(
        np.array(translation) * 1e-3, Rotation.from_rotvec(np.radians(turn))
    )
    return PlanningProblem(preset("fe185"), points, goal, obstacles, **(fields | changes))  # type: ignore[arg-type]


@pytest.fixture(scope="session")
def paper() -> Callable[..., PlanningProblem]:
    return paper_problem


def visible(camera: UnifiedCamera, points: np.ndarray, margin: float) -> bool:
    pixels, valid = camera.project(points)
    inside = valid & (pixels > margin).all(axis=1)
    inside &= (pixels < np.array([camera.width, camera.height]) - 1 - margin).all(axis=1)
    if camera.dead_zone is not None:
        away = np.linalg.norm(pixels - np.array(camera.dead_zone.center), axis=1)
        inside &= away > camera.dead_zone.radius + margin
    return bool(inside.all())


def random_pose(
    rng: np.random.Generator, kind: str, camera: UnifiedCamera, points: np.ndarray
) -> RigidTransform | None:
    """A goal that sees the target; mirrors mostly turn about their axis."""
    largest = CAMERAS[kind][2]
    for _ in range(200):
        t = rng.normal(size=3)
        t *= rng.uniform(0.1, 0.45) / np.linalg.norm(t)
        axis = rng.normal(size=3)
        turn = axis / np.linalg.norm(axis) * np.radians(rng.uniform(0.0, largest))
        if kind == "catadioptric":
            turn = np.array([0.0, 0.0, np.radians(rng.uniform(-largest, largest))]) + 0.3 * axis
        pose = RigidTransform.from_components(t, Rotation.from_rotvec(turn))
        near = np.linalg.norm(points - t, axis=1).min() < 0.05
        if not near and visible(camera, pose.inv().apply(points), 5.0):
            return pose
    return None


def random_obstacles(
    rng: np.random.Generator, kind: str, points: np.ndarray, t: np.ndarray, clearance: float
) -> tuple[Sphere, ...] | None:
    """Obstacles across the straight line, or across the view from it; None where the ends are not free."""
    length = float(np.linalg.norm(t))
    found = []
    for _ in range(rng.integers(1, 4) if kind != "occlusion" else rng.integers(2, 6)):
        at = rng.uniform(0.3, 0.7) * t
        if kind == "occlusion":
            at = at + (points[rng.integers(len(points))] - at) * rng.uniform(0.2, 0.7)
            found.append(Sphere(at + rng.normal(size=3) * 0.02, rng.uniform(0.01, 0.03)))
        else:
            found.append(Sphere(at + rng.normal(size=3) * 0.1 * length))
    free = [
        min(np.linalg.norm(o.center), np.linalg.norm(o.center - t)) > o.radius + clearance + 3e-3
        for o in found
    ]
    return tuple(found) if all(free) else None


def random_problem(rng: np.random.Generator, kind: str, degree: int = 2) -> PlanningProblem:
    """A problem whose end poses are good and whose straight path mostly is not."""
    name, widest, _ = CAMERAS[kind]
    camera = preset(name)
    while True:
        angle, around = rng.uniform(0.0, widest), rng.uniform(0.0, 2.0 * np.pi)
        toward = [np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)]
        points = np.array(toward) * rng.uniform(0.4, 0.9) + rng.uniform(-0.08, 0.08, (9, 3))
        if not visible(camera, points, 5.0):
            continue
        pose = random_pose(rng, kind, camera, points)
        if pose is None:
            continue
        length = float(np.linalg.norm(pose.translation))
        clearance = rng.uniform(0.15, 0.35) * length if kind != "occlusion" else 0.01
        tries = (random_obstacles(rng, kind, points, pose.translation, clearance) for _ in range(50))
        obstacles = next((o for o in tries if o is not None), None)
        if obstacles is None:
            continue
        problem = PlanningProblem.from_dict(
            PlanningProblem(
                camera,
                points,
                pose,
                obstacles,
                clearance=clearance,
                least_distance=0.03,
                visibility_margin=1.0,
                occlusion=kind == "occlusion",
            ).to_dict()
            | {"degrees": {"rotation": degree, "translation": degree}}
        )
        if not violation_at_end(problem):
            return problem


@pytest.fixture(scope="session")
def random_problems() -> Callable[[str, int], list[PlanningProblem]]:
    """The first ``count`` random problems of a kind; always the same ones."""

    def make(kind: str, count: int, degree: int = 2) -> list[PlanningProblem]:
        rng = np.random.default_rng([20120601, sorted(CAMERAS).index(kind)])
        return [random_problem(rng, kind, degree) for _ in range(count)]

    return make


def seen_margins(problem: PlanningProblem, path: CameraPath, w: np.ndarray) -> dict[str, float]:
    """Smallest margins at the samples w, computed from poses and pixels alone, by family."""
    poses = path(w)
    t = poses.translation
    c = np.einsum("kij,kni->knj", poses.as_matrix()[:, :3, :3], problem.points[None] - t[:, None])
    pixels, valid = problem.camera.project(c)
    camera, margin = problem.camera, problem.visibility_margin
    size = np.array([camera.width, camera.height])
    border = np.minimum(pixels + 0.5, size - 0.5 - pixels).min(axis=-1) - margin
    if camera.max_angle is not None:
        rho = np.linalg.norm(c, axis=-1)
        radius = np.hypot(c[..., 0], c[..., 1]) / (c[..., 2] + camera.xi * rho)
        rim = np.sin(camera.max_angle) / (np.cos(camera.max_angle) + camera.xi)
        stretch = np.linalg.svd(camera.matrix[:2, :2], compute_uv=False).min()
        border = np.minimum(border, (rim - radius) * stretch - margin)
    found = {
        "visibility": float(np.where(valid, border, -1e6).min()),
        "least_distance": float(np.linalg.norm(c, axis=-1).min() - problem.least_distance),
    }
    if camera.dead_zone is not None:
        zone = camera.dead_zone
        away = np.linalg.norm(pixels - np.array(zone.center), axis=-1) - zone.radius - margin
        found["dead_zone"] = float(np.where(valid, away, -1e6).min())
    for obstacle in problem.obstacles:
        own = problem.clearance if obstacle.clearance is None else obstacle.clearance
        gap = np.linalg.norm(t - obstacle.center, axis=1).min() - obstacle.radius - own
        found["clearance"] = min(found.get("clearance", np.inf), float(gap))
        if problem.occlusion and obstacle.radius > 0.0:
            line = problem.points[None] - t[:, None]
            p = (t - obstacle.center)[:, None]
            s = np.clip(-(p * line).sum(-1) / (line**2).sum(-1), 0.0, 1.0)
            sight = np.linalg.norm(p + s[..., None] * line, axis=-1).min() - obstacle.radius
            found["occlusion"] = min(found.get("occlusion", np.inf), float(sight))
    if problem.workspace is not None:
        inside = [t @ side.normal - side.offset for side in problem.workspace.half_spaces]
        if problem.workspace.min is not None:
            inside += [*(t - problem.workspace.min).T, *(problem.workspace.max - t).T]
        found["workspace"] = float(np.min(inside))
    return found


@pytest.fixture(scope="session")
def look() -> Callable[[PlanningProblem, CameraPath, np.ndarray], dict[str, float]]:
    return seen_margins
