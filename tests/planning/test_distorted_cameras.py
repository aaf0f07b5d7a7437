"""Distorted cameras: limits are a convex polygon that the plan carries."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.camera_files import load_camera
from omniservo.cameras import UnifiedCamera
from omniservo.planning import CameraPath, Plan, PlanningProblem, Sphere, certify, plan_path
from omniservo.planning.certificate import distorted_margins
from omniservo.planning.certificate.certificate import UNSEEN_PX
from omniservo.planning.constraints.visibility import OUTSIDE
from omniservo.reporting.moment_figure import draw_moment
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 2001)
POINTS = np.array([[0.0, 0.0, 0.6], [0.1, 0.05, 0.55], [-0.1, 0.05, 0.65], [0.05, -0.1, 0.6]])


def camera(**changes: object) -> UnifiedCamera:
    return UnifiedCamera(
        500.0, 505.0, 320.0, 240.0, 0.9, 640, 480, distortion=(-0.1, 0.02, 1e-3, -5e-4), **changes
    )


def problem(**changes: object) -> PlanningProblem:
    goal = RigidTransform.from_components([0.2, 0.0, 0.1], Rotation.from_rotvec([0.0, -0.3, 0.1]))
    given = {
        "camera": camera(),
        "points": POINTS,
        "obstacles": (Sphere([0.1, 0.01, 0.05]),),
        "clearance": 0.05,
        "visibility_margin": 2.0,
    } | changes
    return PlanningProblem(initial_T_goal=goal, **given)


def pixels(asked: PlanningProblem, path: CameraPath) -> np.ndarray:
    poses = path(FINE)
    offsets = asked.points[None] - poses.translation[:, None]
    found, valid = asked.camera.project(np.einsum("kij,kni->knj", poses.rotation.as_matrix(), offsets))
    assert valid.all()
    return found


def test_a_distorted_camera_is_certified_with_its_polygon():
    asked = problem()
    plan = plan_path(asked)
    assert plan.status == "certified"
    names = [c.name for c in plan.certificate.constraints]
    assert any(name.startswith("visibility polygon (point") for name in names)
    assert not any("edge" in name or "max_angle" in name for name in names)
    polygon = plan.certificate.polygon
    assert plan.to_dict()["certificate"]["polygon"] == polygon.tolist()
    verdict = verify_plan(plan)
    assert (verdict.status, verdict.reasons) == ("certified", ())


def test_the_margin_of_the_polygon_is_a_lower_bound_and_not_loose():
    asked = problem()
    plan = plan_path(asked)
    seen = pixels(asked, plan.path)
    truth = np.minimum(seen + 0.5, np.array([639.5, 479.5]) - seen).min() - 2.0
    stated = next(c.margin for c in plan.certificate.constraints if c.name.startswith("visibility"))
    assert truth - 3.0 <= stated <= truth


def test_paths_of_one_camera_share_its_polygons(monkeypatch):
    """Each takes longer than all else, and a margin that is not rounded has one of its own."""
    made, limits, path = [], UnifiedCamera.image_limits, plan_path(problem()).path
    distorted_margins._limits_at.cache_clear()
    monkeypatch.setattr(UnifiedCamera, "image_limits", lambda self, m=0.0: made.append(m) or limits(self, m))
    counts = []
    for aside in np.linspace(0.0, 0.002, 6):
        made.clear()
        certify(problem(points=POINTS + np.array([aside, 0.0, 0.0])), path)
        counts.append(len(made))
    assert sum(counts[1:]) < 3 * counts[0], counts


def test_a_dead_zone_under_distortion_is_certified():
    ring = POINTS + np.array([0.0, 0.28, 0.0])
    asked = problem(camera=camera(dead_zone=((325.0, 245.0), 40.0)), points=ring)
    plan = plan_path(asked)
    assert plan.status == "certified", plan.reason
    stated = next(c.margin for c in plan.certificate.constraints if c.name.startswith("dead_zone"))
    away = np.linalg.norm(pixels(asked, plan.path) - [325.0, 245.0], axis=-1).min() - 40.0 - 2.0
    assert 0.0 <= stated <= away
    assert verify_plan(plan).status == "certified"


def test_a_margin_is_what_is_proven_of_it_whatever_the_looks_have_seen(monkeypatch):
    """Every look sees 60 px too much."""
    ring = POINTS + np.array([0.0, 0.28, 0.0])
    asked = problem(camera=camera(dead_zone=((325.0, 245.0), 40.0)), points=ring)
    path, looks = plan_path(asked).path, distorted_margins._seen_margins
    monkeypatch.setattr(
        distorted_margins,
        "_seen_margins",
        lambda *given: [(name, (least + 60.0, w, j)) for name, (least, w, j) in looks(*given)],
    )
    seen = pixels(asked, path)
    truth = {
        "visibility polygon": np.minimum(seen + 0.5, np.array([639.5, 479.5]) - seen).min() - 2.0,
        "dead_zone": np.linalg.norm(seen - [325.0, 245.0], axis=-1).min() - 40.0 - 2.0,
    }
    _, certificate = certify(asked, path)
    for name, most in truth.items():
        stated = next(c.margin for c in certificate.constraints if c.name.startswith(name))
        assert most - 3.0 <= stated <= most


def test_a_point_outside_a_distorted_image_is_infeasible_by_its_pixel():
    plan = plan_path(problem(points=[[0.0, 0.0, 0.6], [0.5, 0.0, 0.3]]))
    assert plan.status == "infeasible"
    assert "visibility right edge (point 1)" in plan.reason
    assert verify_plan(plan).reasons[0].startswith("infeasible confirmed")


def test_a_point_lost_only_to_the_polygon_is_undecided_and_never_infeasible():
    """Just inside the image's corner, where a convex polygon cannot follow a pincushion's border."""
    lens = UnifiedCamera(400.0, 400.0, 320.0, 240.0, 0.0, 640, 480, distortion=(-0.15, 0.0, 0.0, 0.0))
    polygon = lens.image_limits(0.0).polygon
    lost = None
    for u, v in ((638.5, 240.0), (320.0, 478.5), (638.5, 478.5), (638.8, 478.8), (639.3, 479.3)):
        (x, y, z), valid = lens.unproject([u, v])
        corners = np.roll(polygon, -1, axis=0) - polygon
        to_point = np.array([x / z, y / z]) - polygon
        inside = (corners[:, 0] * to_point[:, 1] - corners[:, 1] * to_point[:, 0] > 0).all()
        if valid and not inside:
            lost = np.array([[x, y, z]])
    assert lost is not None
    goal = RigidTransform.from_components([0.0, 0.0, -0.05], Rotation.identity())
    asked = PlanningProblem(lens, lost, goal)
    plan = plan_path(asked)
    assert plan.status == "undecided"
    assert "visibility polygon (point 0)" in plan.reason
    tight = replace(asked, obstacles=(Sphere([0.1, 0.0, 0.0]),), clearance=0.0999999)
    plan = plan_path(tight)
    assert plan.certificate.worst.name == "clearance obstacle 0"
    assert "visibility polygon (point 0)" in plan.reason, "a constraint that is proven is no reason"


@pytest.mark.parametrize(
    "zone", [{"dead_zone": ((325.0, 245.0), 40.0)}, {"mask": [[[300, 200], [340, 200], [340, 260]]]}]
)
def test_a_target_that_the_lens_never_sees_has_no_plan(zone):
    """Beyond the lens's largest angle all the way: there is no pixel to measure from the zone."""
    asked = problem(camera=camera(max_angle=0.5, **zone), points=POINTS + np.array([0.0, 1.5, 0.0]))
    plan = plan_path(asked)
    assert plan.status == "not_found"
    assert "visibility polygon (point 0): no pixel at w = " in plan.reason
    assert all(np.isfinite(c.margin) for c in plan.certificate.constraints)
    assert UNSEEN_PX == OUTSIDE
    assert draw_moment(plan).title.startswith("not_found: visibility polygon (point 0): no pixel")
    assert verify_plan(plan).status == "refuted"


def test_a_path_that_leaves_a_distorted_image_is_refuted():
    asked = problem(obstacles=(), visibility_margin=0.0)
    plan = plan_path(asked)
    swing = np.array([0.0, 4.0, 0.0, 0.0])
    total = asked.goal_quaternion - [0, 0, 0, 1]
    rotation = np.column_stack([-swing, total + swing, [0.0, 0.0, 0.0, 1.0]])
    path = CameraPath(rotation, plan.path.translation)
    verdict, certificate = certify(asked, path)
    assert verdict == "refuted"
    stated = Plan(asked, "refuted", path, certificate, 0.0, "certified")
    assert verify_plan(stated).status == "refuted"


@pytest.mark.parametrize(
    "name",
    [
        "KITTI-360__image_02",
        "KITTI-360__image_03",
        "VINS-Fusion__mynteye_left_mei",
        "TixiaoShan_LVI-SAM__params_camera",
        "VINS-Fusion__simulation_cam0_mei",
    ],
)
def test_plans_with_real_calibrations_are_certified_and_verified(shared_data, name):
    file = shared_data / "calibrations" / "mei_yaml" / f"{name}.yaml"
    if not file.is_file():
        pytest.skip(f"not present: {file.name}")
    ahead = np.array([[0.0, 0.0, 0.8], [0.1, 0.1, 0.9], [-0.1, 0.05, 0.85], [0.05, -0.1, 0.8]])
    goal = RigidTransform.from_components([0.1, 0.0, 0.1], Rotation.from_rotvec([0.0, -0.1, 0.1]))
    asked = PlanningProblem(load_camera(file), ahead, goal, (Sphere([0.05, 0.005, 0.05]),), clearance=0.03)
    plan = plan_path(asked)
    assert plan.status == "certified", plan.reason
    assert verify_plan(plan).status == "certified"
