"""The numbers behind the figures, against independent computations."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.reporting.curves import executed_curve, planned_curve
from omniservo.reporting.image_distance import image_distance
from omniservo.reporting.margins import certified_clearance, certified_visibility
from omniservo.reporting.robot_motion import robot_position
from omniservo.reporting.space import box_edges, box_faces
from omniservo.reporting.upright_axes import UprightAxes

PERSPECTIVE = UnifiedCamera(400.0, 400.0, 319.5, 239.5, 0.0, 640, 480)


@pytest.mark.parametrize(
    ("pixel", "distance"),
    [
        ((319.5, 239.5), 240.0),
        ((-0.5, 100.0), 0.0),
        ((639.5, 100.0), 0.0),
        ((-3.5, 50.0), -3.0),
        ((100.0, 470.0), 9.5),
    ],
)
def test_distance_to_the_edges_counts_from_the_outer_sides_of_the_pixels(pixel, distance):
    assert image_distance(PERSPECTIVE, np.array(pixel)) == pytest.approx(distance)


def test_distance_to_the_lens_circle_is_zero_on_it_and_nothing_beyond_it_counts_as_seen():
    camera = UnifiedCamera(300.0, 300.0, 1000.0, 1000.0, 1.3, 2000, 2000, max_angle=np.deg2rad(90.0))
    radius = 300.0 / 1.3
    for inside in (0.0, 10.0, radius - 0.5):
        pixel = np.array([1000.0, 1000.0 - inside])
        assert image_distance(camera, pixel) == pytest.approx(radius - inside, abs=1e-9)
    on_it = np.array([1000.0 + radius - 1e-6, 1000.0])
    assert image_distance(camera, on_it) == pytest.approx(1e-6, abs=1e-9)
    assert not image_distance(camera, np.add(on_it, [1.0, 0.0])) >= 0.0


def test_distance_to_a_dead_zone_is_negative_inside():
    camera = UnifiedCamera(400.0, 400.0, 319.5, 239.5, 1.0, 640, 480, dead_zone=((320.0, 240.0), 50.0))
    assert image_distance(camera, np.array([320.0, 240.0])) == pytest.approx(-50.0)
    assert image_distance(camera, np.array([380.0, 240.0])) == pytest.approx(10.0)


def test_distance_to_a_mask_is_how_far_its_edges_can_move():
    square = [[300, 200], [340, 200], [340, 260], [300, 260]]
    camera = UnifiedCamera(400.0, 400.0, 319.5, 239.5, 0.0, 640, 480, mask=[square])
    pixels = np.array([[320.0, 210.0], [350.0, 230.0], [345.0, 268.0], [635.0, 240.0]])
    np.testing.assert_allclose(image_distance(camera, pixels), [-10.0, 10.0, 8.0, 4.5])


def test_distance_of_a_lost_dot_is_not_a_number():
    assert np.isnan(image_distance(PERSPECTIVE, np.array([np.nan, np.nan])))


def test_planned_curve_starts_at_the_start_and_ends_at_the_goal(run):
    curve = planned_curve(run)
    np.testing.assert_allclose(curve.positions[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(curve.positions[-1], run.estimate.initial_T_goal.translation, atol=1e-8)
    np.testing.assert_allclose(curve.pixels[0], run.initial_pixels, atol=1e-6)
    np.testing.assert_allclose(curve.pixels[-1], run.goal_pixels, atol=1e-4)


def test_planned_curve_keeps_the_certified_bounds(run):
    curve = planned_curve(run)
    assert curve.clearances.min() >= certified_clearance(run)
    assert curve.visibility.min() >= certified_visibility(run)
    assert certified_clearance(run) >= run.task.planning.clearance + run.task.planning.tracking_margin


def test_executed_clearance_is_the_distance_to_the_points_of_the_task(run):
    curve = executed_curve(run)
    for i, obstacle in enumerate(run.task.planning.obstacles):
        expected = [np.linalg.norm(row.true_position - np.array(obstacle.center)) for row in run.log.rows]
        np.testing.assert_allclose(curve.clearances[:, i], expected)


def test_virtual_plane_is_the_point_over_its_depth(run):
    curve = planned_curve(run)
    k = 123
    pose = run.plan.path(curve.w[k])
    c = pose.inv().apply(run.estimate.points)
    np.testing.assert_allclose(curve.plane[k], c[:, :2] / c[:, 2:], atol=1e-12)


def test_a_run_without_steps_gives_curves_without_moments(stopped_run):
    curve = executed_curve(stopped_run)
    assert len(curve) == 0
    assert curve.pixels.shape == (0, 9, 2)
    assert curve.clearances.shape == (0, 2)


def test_robot_coordinates_are_the_papers(run):
    """Example 1: the flange starts at (−50, 500, 150) mm and ends near (−50, 400, 350) mm."""
    start = RigidTransform.from_translation([0.0, 0.0, 0.0])
    np.testing.assert_allclose(robot_position(run, start), [-0.050, 0.500, 0.150], atol=1e-3)
    np.testing.assert_allclose(
        robot_position(run, run.estimate.initial_T_goal), [-0.050, 0.400, 0.350], atol=1e-3
    )


@pytest.mark.parametrize("seed", range(6))
def test_figures_of_space_are_upright_and_not_mirrored(seed):
    rotation = Rotation.random(rng=np.random.default_rng(seed))
    upright = UprightAxes.for_start(RigidTransform.from_rotation(rotation))
    page_R_camera = np.zeros((3, 3))
    page_R_camera[range(3), list(upright.order)] = upright.signs
    assert np.linalg.det(page_R_camera) == pytest.approx(1.0)
    up_in_camera = rotation.inv().apply([0.0, 0.0, 1.0])
    assert (page_R_camera @ up_in_camera)[2] == pytest.approx(np.abs(up_in_camera).max())


def test_a_box_has_twelve_edges_and_six_faces_of_its_lengths():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], dtype=float)
    lengths = sorted(float(np.linalg.norm(b - a)) for a, b in box_edges(corners))
    assert lengths == [1.0] * 4 + [2.0] * 4 + [3.0] * 4
    for face in box_faces(corners):
        flat = face.reshape(-1, 3)
        assert (np.ptp(flat, axis=0) == 0).sum() == 1
