"""Image masks: target points are kept out of convex polygons in pixels."""

import json

import numpy as np
import pytest
from matplotlib.path import Path as Outline
from scipy.optimize import minimize_scalar
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.geometry.subdivision import PROVEN, REFUTED, UNDECIDED
from omniservo.planning import CameraPath, Plan, PlanningProblem, certify, plan_path
from omniservo.planning.bernstein_path import camera_controls, camera_count
from omniservo.planning.constraints.image_mask import moved_outward, prove_outside_mask
from omniservo.planning.problem_arrays import constraints_of
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 4001)
POINTS = [[-0.03, -0.02, 0.6], [0.03, -0.02, 0.55], [0.0, 0.04, 0.6]]
BLOCK = [[300, 225], [355, 225], [370, 260], [355, 290], [300, 290]]
"""between the places of the target at the start and at the goal"""


def masked(name: str, mask: list) -> UnifiedCamera:
    return UnifiedCamera.from_dict(preset(name).to_dict() | {"mask": mask})


def problem(mask, **changes: object) -> PlanningProblem:
    """The target is seen on the right at the start, on the left at the goal."""
    fields = {
        "format": "omniservo.problem/1",
        "camera": masked("fe185", mask).to_dict(),
        "points": [[x + 0.35, y, z] for x, y, z in POINTS],
        "goal": {"translation": [0.7, 0.0, 0.0], "quaternion": [0.0, 0.0, 0.0, 1.0]},
    }
    return PlanningProblem.from_dict(fields | changes)


def pixels_along(camera: UnifiedCamera, path: CameraPath, points: np.ndarray, w: np.ndarray) -> np.ndarray:
    poses = path(w)
    offsets = points[None] - poses.translation[:, None]
    return camera.project(np.einsum("kij,kni->knj", poses.as_matrix()[:, :3, :3], offsets))[0]


def beyond(corners, pixels: np.ndarray) -> np.ndarray:
    """How far pixels (…, 2) are beyond the polygon, from SciPy's hull: the definition."""
    lines = ConvexHull(np.array(corners, dtype=float)).equations
    return (pixels @ lines[:, :2].T + lines[:, 2]).max(axis=-1)


def random_polygon(rng: np.random.Generator, centre: np.ndarray) -> np.ndarray:
    points = rng.normal(size=(6, 2)) * 40.0 + centre
    corners = points[ConvexHull(points).vertices]
    return corners[::-1] if rng.random() < 0.5 else corners


@pytest.mark.parametrize("xi", [0.0, 0.8, 1.0, 1.291])
def test_a_polygon_is_decided_on_either_side_of_the_truth(xi):
    """Polygons beside random ways of a point; the truth by sampling and a bounded search around the least.

    Where two edges meet, what is 1e-6 px inside may lie between the smallest pieces: that is undecided.
    """
    rng = np.random.default_rng(int(100 * xi))
    decided = 0
    while decided < 40:
        phi, t = rng.normal(size=(4, 3)) * 0.2, rng.normal(size=(3, 3)) * 0.15
        phi[:, -1], t[:, -1] = [0.0, 0.0, 0.0, 1.0], 0.0
        path, h = CameraPath(phi, t), np.array([[0.0, 0.0, 1.0]]) + rng.normal(size=(1, 3)) * 0.1
        bare = UnifiedCamera(300.0, -310.0, 320.0, 240.0, xi, 640, 480, skew=3.0)
        way = pixels_along(bare, path, h, FINE)[:, 0]
        if not np.isfinite(way).all():
            continue
        corners = random_polygon(rng, way[rng.integers(len(way))] + rng.normal(size=2) * 60.0)
        values = beyond(corners, way)
        k = int(values.argmin())
        around = FINE[max(k - 1, 0)], FINE[min(k + 1, len(FINE) - 1)]

        def left(w, path=path, h=h, corners=corners, bare=bare):
            return float(beyond(corners, pixels_along(bare, path, h, np.array([w])))[0, 0])

        found = minimize_scalar(left, bounds=around, method="bounded", options={"xatol": 1e-13}).fun
        truth = min(float(found), float(values.min()))
        camera = UnifiedCamera.from_dict(bare.to_dict() | {"mask": [corners.tolist()]})
        asked = PlanningProblem(camera, h, problem([]).initial_T_goal)
        edges = constraints_of(asked, camera.image_limits()).mask_edges
        controls, errors = camera_controls(phi, t, h)
        count = float(camera_count(2, 2))
        decided += 1
        for grown, legal in (
            (truth - 1e-3, (PROVEN,)),
            (truth + 1e-3, (REFUTED,)),
            (truth + 1e-6, (REFUTED, UNDECIDED)),
        ):
            status, w, j = prove_outside_mask(controls, errors, count, moved_outward(edges, grown, xi))
            assert status in legal
            assert j == 0
            if status == REFUTED:
                assert left(w) < grown


def test_a_path_goes_round_a_mask_between_start_and_goal():
    asked = problem([BLOCK], visibility_margin=2.0)
    straight = CameraPath([[0.0, 0.0]] * 3 + [[0.0, 1.0]], [[0.7, 0.0], [0.0, 0.0], [0.0, 0.0]])
    verdict, certificate = certify(asked, straight)
    assert verdict == "refuted"
    assert any(c.name.startswith("visibility mask 0") and c.margin < -2.0 for c in certificate.constraints)
    plan = plan_path(asked)
    assert plan.status == "certified", plan.reason
    way = pixels_along(asked.camera, plan.path, asked.points, FINE).reshape(-1, 2)
    assert not Outline(BLOCK).contains_points(way).any()
    assert asked.camera.in_image(way).all()
    (line,) = [c for c in plan.certificate.constraints if c.name.startswith("visibility mask")]
    assert line.unit == "px"
    seen = beyond(BLOCK, way).min() - 2.0
    assert 0.0 <= line.margin <= seen < line.margin + 0.01


def test_each_polygon_has_its_line_and_a_margin_that_is_not_loose():
    far = [[20, 20], [60, 30], [25, 70]]
    asked = problem([far, BLOCK[::-1]])
    plan = plan_path(asked)
    assert plan.status == "certified", plan.reason
    found = {c.name.split(" (")[0]: c.margin for c in plan.certificate.constraints if "mask" in c.name}
    assert list(found) == ["visibility mask 0", "visibility mask 1"]
    way = pixels_along(asked.camera, plan.path, asked.points, FINE)
    for corners, margin in zip((far, BLOCK), found.values(), strict=True):
        seen = beyond(corners, way).min()
        assert margin <= seen < margin + 0.01
    assert verify_plan(plan).status == "certified"


@pytest.mark.parametrize("off", [1e-3, 1e-5])
def test_a_violation_between_samples_is_never_certified(off):
    """The margin asked for grows past the true smallest distance."""
    asked = problem([BLOCK])
    path = plan_path(asked).path
    way = pixels_along(asked.camera, path, asked.points, FINE)
    values = beyond(BLOCK, way)
    k, j = np.unravel_index(values.argmin(), values.shape)

    def left(w: float) -> float:
        return float(beyond(BLOCK, pixels_along(asked.camera, path, asked.points, np.array([w])))[0, j])

    near = FINE[max(k - 1, 0)], FINE[min(k + 1, len(FINE) - 1)]
    truth = float(minimize_scalar(left, bounds=near, method="bounded", options={"xatol": 1e-13}).fun)
    assert truth > 0.0
    tight = problem([BLOCK], visibility_margin=truth + off)
    verdict, certificate = certify(tight, path)
    assert verdict == "refuted"
    assert verify_plan(Plan(tight, "certified", path, certificate, 0.0, "certified")).status == "refuted"
    assert certify(problem([BLOCK], visibility_margin=truth - off), path)[0] == "certified"


def test_a_point_in_a_mask_at_an_end_pose_makes_the_problem_infeasible():
    asked = problem([[[0, 0], [639, 0], [639, 430], [0, 430]]])
    plan = plan_path(asked)
    assert plan.status == "infeasible"
    assert "start pose (w = 0) violates visibility mask 0 (point " in plan.reason


def test_mirrors_and_turns_are_planned_round_masks():
    """A rod in front of a mirror, the camera turning about its axis: the points must not cross it."""
    base = preset("para-catadioptric")
    around = Rotation.from_rotvec([0.0, 0.0, 1.2])
    points = np.array([[0.5, 0.02, 0.25], [0.5, -0.03, 0.28]])
    turned = [Rotation.from_rotvec([0.0, 0.0, angle]).inv().apply(points) for angle in (0.0, 0.6, 1.2)]
    start, middle, goal = (base.project(c)[0].mean(axis=0) for c in turned)
    assert min(np.linalg.norm(start - middle), np.linalg.norm(goal - middle)) > 60.0
    rod = [[middle[0] + x, middle[1] + y] for x, y in ((-12, -12), (12, -12), (12, 12), (-12, 12))]
    fields = {
        "format": "omniservo.problem/1",
        "camera": masked("para-catadioptric", [rod]).to_dict(),
        "points": points.tolist(),
        "goal": {"translation": [0.05, 0.0, 0.0], "quaternion": around.as_quat().tolist()},
        "visibility_margin": 3.0,
    }
    asked = PlanningProblem.from_dict(fields)
    plan = plan_path(asked)
    assert plan.status == "certified", plan.reason
    way = pixels_along(asked.camera, plan.path, asked.points, FINE)
    assert beyond(rod, way).min() >= 3.0


def test_a_plan_keeps_the_mask_in_its_camera(tmp_path):
    plan = plan_path(problem([BLOCK]))
    plan.save(tmp_path / "plan.json")
    assert json.loads((tmp_path / "plan.json").read_text())["problem"]["camera"]["mask"] == [BLOCK]
    assert Plan.load(tmp_path / "plan.json").problem.camera == plan.problem.camera


def test_a_distorted_camera_plans_round_its_mask_and_both_judges_agree():
    bare = UnifiedCamera(300.0, 298.0, 320.0, 216.0, 1.2, 659, 432, distortion=(-0.05, 0.01, 1e-3, -5e-4))
    ends = bare.project(np.array(problem([]).points))[0]
    middle = ends.mean(axis=0) * [0.0, 1.0] + [320.0, 0.0]
    corners = (middle + np.array([[-25, -20], [20, -25], [30, 10], [0, 25]])).tolist()
    camera = UnifiedCamera.from_dict(bare.to_dict() | {"mask": [corners]})
    asked = problem([], camera=camera.to_dict(), visibility_margin=3.0)
    straight = CameraPath([[0.0, 0.0]] * 3 + [[0.0, 1.0]], [[0.7, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert certify(asked, straight)[0] == "refuted"
    plan = plan_path(asked)
    assert plan.status == "certified", plan.reason
    truth = beyond(corners, pixels_along(bare, plan.path, asked.points, FINE)).min() - 3.0
    stated = next(c.margin for c in plan.certificate.constraints if "mask" in c.name)
    assert truth - 1.0 < stated <= truth
    assert verify_plan(plan).status == "certified"
    more = problem([], camera=camera.to_dict(), visibility_margin=3.5 + truth)
    assert certify(more, plan.path)[0] == "refuted"
    away = np.add(corners, [0.0, 120.0 if middle[1] < 216.0 else -120.0]).tolist()
    both = UnifiedCamera.from_dict(bare.to_dict() | {"mask": [corners, away]})
    _, certificate = certify(problem([], camera=both.to_dict(), visibility_margin=3.0), plan.path)
    for i, polygon in enumerate((corners, away)):
        truth = beyond(polygon, pixels_along(bare, plan.path, asked.points, FINE)).min() - 3.0
        stated = next(c.margin for c in certificate.constraints if f"mask {i} " in c.name)
        assert truth - 1.0 < stated <= truth
