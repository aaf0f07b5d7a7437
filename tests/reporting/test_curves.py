"""The numbers behind the figures, against independent computations."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.reporting.curves import executed_curve, planned_curve
from omniservo.reporting.image_distance import image_distance
from omniservo.reporting.margins import certified_clearance, certified_visibility
from omniservo.reporting.robot_motion import continuous, robot_position
from omniservo.reporting.space import box_faces, cut_faces, cut_hull, space_of
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


@pytest.mark.parametrize(("xi", "angle", "rim"), [(0.6, 2.4, np.inf), (1.0, np.pi, np.inf), (1.3, 2.6, 1.0)])
def test_an_angle_past_the_models_domain_limits_no_more_than_the_domain(xi, angle, rim):
    camera = UnifiedCamera(150.0, 150.0, 319.5, 239.5, xi, 640, 480, max_angle=angle)
    circle = rim * 150.0 / np.sqrt(1.3**2 - 1.0)
    pixels = np.array([[319.5, 239.5], [369.5, 239.5]])
    np.testing.assert_allclose(image_distance(camera, pixels), np.minimum(240.0, circle - [0.0, 50.0]))


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


def box(low, high):
    return np.array(list(product(*zip(low, high, strict=True))))


def test_a_box_has_six_flat_faces_whose_sides_are_its_edges():
    faces = box_faces(box((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)))
    lengths = sorted(float(n) for f in faces for n in np.linalg.norm(f - np.roll(f, 1, axis=0), axis=1))
    assert lengths == [1.0] * 8 + [2.0] * 8 + [3.0] * 8
    for face in faces:
        assert (np.ptp(face, axis=0) == 0).sum() == 1


@pytest.mark.parametrize("seed", range(5))
def test_what_is_cut_to_the_view_is_what_both_share(seed):
    """Volumes of random hulls cut to a box, against shares of random points."""
    rng = np.random.default_rng(seed)
    view = np.array([[-0.5, -0.4, -0.6], [0.7, 0.5, 0.6]])
    points = rng.normal(size=(12, 3)) + rng.normal(size=3) * 0.3
    cut = cut_hull(points, view)
    samples = rng.uniform(*view, size=(20_000, 3))
    share = np.mean(Delaunay(points).find_simplex(samples) >= 0)
    assert ConvexHull(cut).volume == pytest.approx(share * np.prod(view[1] - view[0]), abs=0.02)
    assert (cut >= view[0] - 1e-12).all()
    assert (cut <= view[1] + 1e-12).all()


def test_a_long_body_is_cut_and_one_out_of_view_is_left_out():
    view = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    long = cut_faces(box_faces(box((-9.0, -0.1, -0.1), (9.0, 0.1, 0.1))), view)
    assert np.ptp(np.vstack(long), axis=0) == pytest.approx([2.0, 0.2, 0.2])
    assert len(long) == 4
    assert cut_faces(box_faces(box((2.0, 2.0, 2.0), (3.0, 3.0, 3.0))), view) == ()
    assert len(cut_hull(box((2.0, 2.0, 2.0), (3.0, 3.0, 3.0)), view)) == 0


@pytest.mark.parametrize("task", ["paper-example-1", "ur5e-table", "whole-arm-1"])
def test_path_and_target_fill_the_figure_of_space_however_long_obstacles_are(made_up_run, task):
    run = made_up_run(task, steps=5)
    space = space_of(run, UprightAxes.for_start(run.task.start.world_T_camera.transform))
    core = np.vstack([space.points, space.executed, space.planned])
    longest = np.ptp(core, axis=0).max()
    assert np.ptp(space.view, axis=0).max() < 1.6 * longest
    for part in (*(f for faces in space.bodies for f in faces), *(r.outline for r in space.keep_out)):
        assert (part >= space.view[0] - 1e-6).all()
        assert (part <= space.view[1] + 1e-6).all()


def test_a_rotation_has_no_jump_where_it_passes_half_a_turn():
    angle = np.linspace(0.0, 2.5 * np.pi, 300)
    for axis in ([0.6, 0.0, 0.8], [0.0, 0.0, -1.0]):
        vectors = angle[:, None] * axis
        wrapped = Rotation.from_rotvec(vectors).as_rotvec()
        assert np.abs(np.diff(wrapped, axis=0)).max() > 3.0
        np.testing.assert_allclose(continuous(wrapped), vectors, atol=1e-9)
    there_and_back = np.concatenate([vectors, vectors[::-1]])
    found = continuous(Rotation.from_rotvec(there_and_back).as_rotvec())
    np.testing.assert_allclose(found, there_and_back, atol=1e-9)
    assert continuous(np.zeros((0, 3))).shape == (0, 3)
