"""The ray-cast image against projection, quadrature and its own mask."""

import re

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.robots import Arm
from omniservo.scenes import Ball, SceneBox, Sensor
from omniservo.simulation import UnifiedRenderer, World
from omniservo.simulation.unified_renderer import BACKGROUND, DARK

WINDOW = 9  # [px] half side of the window round a dot


@pytest.fixture(scope="module")
def wall_renderer(make_scene):
    return UnifiedRenderer(World(make_scene()))


def disc_centroid(camera, camera_T_world, center, normal, radius):
    """Centroid of a disc's image: mean of the projection, weighted with its Jacobian determinant."""
    first, second = np.linalg.svd(normal[None])[2][1:]
    radii = (np.arange(40) + 0.5) / 40 * radius
    angles = np.arange(90) * 2 * np.pi / 90
    spread = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    points = center + radii[:, None, None] * spread

    def projected(offset):
        return camera.project(camera_T_world.apply((points + offset).reshape(-1, 3)))[0].reshape(40, 90, 2)

    step = 1e-6
    along = projected(step * first) - projected(-step * first)
    across = projected(step * second) - projected(-step * second)
    area = np.abs(along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0]) * radii[:, None]
    return (projected(0.0) * area[..., None]).sum(axis=(0, 1)) / area.sum()


def dot_errors(scene, image, q):
    """Distances [px]: grey-weighted moments to the discs' centroids; those to the projected centres."""
    camera_T_world = scene.world_T_camera(q).inv()
    offsets = np.arange(-WINDOW, WINDOW + 1)
    for center, normal in zip(scene.dots.centers, scene.dots.normals, strict=True):
        pixel, valid = scene.camera.project(camera_T_world.apply(center))
        if not valid or (np.abs(pixel - [329, 215.5]) > [329 - 2 * WINDOW, 215.5 - 2 * WINDOW]).any():
            continue
        column, row = np.rint(pixel).astype(int)
        window = image[row - WINDOW : row + WINDOW + 1, column - WINDOW : column + WINDOW + 1]
        darkness = window[0, 0] - window
        if np.ptp(window[[0, -1]]) > 1e-9 or np.ptp(window[:, [0, -1]]) > 1e-9:
            continue  # another edge in the window
        moment = np.array([darkness.sum(0) @ offsets, darkness.sum(1) @ offsets]) / darkness.sum()
        truth = disc_centroid(scene.camera, camera_T_world, center, normal, scene.dots.radius)
        yield np.linalg.norm(np.add(moment, (column, row)) - truth), np.linalg.norm(truth - pixel)


def test_dot_centres_are_where_projection_puts_them(make_scene, wall_renderer):
    scene = make_scene()
    rng = np.random.default_rng(3)
    errors, biases = [], []
    for _ in range(5):
        q = scene.start_joints + rng.uniform(-0.12, 0.12, 6)
        for error, bias in dot_errors(scene, wall_renderer.render(q), q):
            errors.append(error)
            biases.append(bias)
    assert len(errors) > 100
    assert np.median(errors) <= 0.02
    assert np.max(errors) <= 0.06
    assert np.max(biases) < 0.05  # a circle's image centre is not the image of its centre, but nearly


def test_pixels_outside_the_image_circle_are_dark_and_those_inside_are_not(make_scene, wall_renderer):
    scene = make_scene()
    image = wall_renderer.render(scene.start_joints)
    v, u = np.indices(image.shape)
    _, valid = scene.camera.unproject(np.stack([u, v], axis=-1).astype(float))
    inner = valid.copy()
    inner[1:] &= valid[:-1]
    inner[:-1] &= valid[1:]
    inner[:, 1:] &= valid[:, :-1]
    inner[:, :-1] &= valid[:, 1:]
    radius = np.hypot(u - 316.8076, v - 254.9012)
    assert (image[radius > 242] == DARK).all()
    assert (image[~valid] <= BACKGROUND + 0.6).all()
    bright = image[inner & (radius < 234)]
    assert (bright > DARK).all()


def test_circle_rim_is_smooth(make_scene, wall_renderer):
    image = wall_renderer.render(make_scene().start_joints)
    row = image[255, 70:90]  # the rim lies at about u = 79
    assert ((row > DARK + 0.005) & (row < row.max() - 0.005)).any()


def test_camera_sees_its_own_arm_at_the_rim_but_not_its_housing(make_scene):
    scene = make_scene(boards=(), dots=None, floor=None)
    image = UnifiedRenderer(World(scene)).render(scene.start_joints)
    yellow = image > BACKGROUND + 0.02
    v, u = np.nonzero(yellow)
    assert len(v) > 500
    assert (np.hypot(u - 316.8, v - 254.9) > 180).all()


def test_facets_of_an_arm_s_mesh_are_seen_by_one_ray_a_pixel_and_its_outline_by_several(make_scene, tmp_path):
    """A link of some makers has ten thousand facets: as edges they took most rays of an image."""
    text = Arm.rx60().path.read_text()
    corners = "0 0 .3  .06 0 .34  -.06 0 .34  0 .06 .34  0 -.06 .34  0 0 .4"
    text = text.replace("<worldbody>", f'<asset><mesh name="part" vertex="{corners}"/></asset><worldbody>')
    site = re.search(r'<site name="flange"[^>]*>', text)[0]
    seen = '<geom type="mesh" mesh="part" contype="0" conaffinity="0" rgba="0.9 0.9 0.9 1"/>'
    (tmp_path / "arm.xml").write_text(text.replace(site, site + seen))
    scene = make_scene(arm=Arm(tmp_path / "arm.xml"), boards=(), dots=None, floor=None)
    image = UnifiedRenderer(World(scene)).render(scene.start_joints)
    part = ndimage.label(image > BACKGROUND + 0.02)[0]
    middle = part == part[255, 317]
    assert middle.sum() > 1000
    inside = ndimage.binary_erosion(middle, iterations=2)
    assert 3 <= len(np.unique(image[inside].round(9))) <= 8  # a grey for each facet, and none between
    rim = middle & ~ndimage.binary_erosion(middle)
    assert len(np.unique(image[rim].round(9))) > 8


def test_dead_zone_and_mask_are_dark(make_scene, fisheye):
    camera = UnifiedCamera(
        **{k: getattr(fisheye, k) for k in ("fx", "fy", "cx", "cy", "xi", "width", "height", "max_angle")},
        dead_zone=((320.0, 250.0), 40.0),
        mask=[[(250, 300), (280, 300), (265, 330)]],
    )
    image = UnifiedRenderer(World(make_scene(camera=camera))).render(make_scene().start_joints)
    v, u = np.indices(image.shape)
    distance = np.hypot(u - 320.0, v - 250.0)
    assert (image[distance < 38.5] == DARK).all()
    assert (image[(distance > 41.5) & (distance < 50)] > DARK).all()
    assert (image[302:318, 265] == DARK).all()
    assert (image[290:299, 265] > DARK).all()
    assert (image[331:340, 265] > DARK).all()


@pytest.mark.parametrize("xi", [0.0, 0.9, 1.0, 2.0])
def test_straight_edge_of_a_board_lies_on_the_projected_line(make_scene, xi):
    camera = UnifiedCamera(200 * (1 + xi), 200 * (1 + xi), 160, 120, xi, 320, 240)
    base = make_scene()
    pose = base.world_T_camera(base.start_joints)
    half_plane = SceneBox("edge", pose * RigidTransform.from_translation([0.305, 0, 0.5]), [0.3, 0.6, 0.01])
    scene = make_scene(camera=camera, boards=(half_plane,), dots=None, floor=None)
    image = UnifiedRenderer(World(scene)).render(base.start_joints)
    inside, outside = image[120, 200], image[120, 140]
    for row in (60, 120, 200):
        line = image[row, 120:200]
        covered = ((line - outside) / (inside - outside)).sum()
        crossing = 199.5 - covered
        y_grid = np.linspace(-0.6, 0.6, 4001)
        points = np.stack([np.full_like(y_grid, 0.005), y_grid, np.full_like(y_grid, 0.49)], axis=-1)
        pixels = camera.project(points)[0]
        expected = np.interp(row, pixels[:, 1], pixels[:, 0])
        assert crossing == pytest.approx(expected, abs=0.15)


def test_nearer_body_hides_the_farther(make_scene):
    base = make_scene()
    ahead = base.world_T_camera(base.start_joints).apply([0, 0, 0.2])
    scene = make_scene(obstacles=(Ball("knob", ahead, 0.05, colour=(0, 0, 0)),))
    image = UnifiedRenderer(World(scene)).render(base.start_joints)
    assert image[255, 317] == 0.0


def test_photograph_is_the_rendering_plus_noise_of_the_stated_size(make_scene):
    scene = make_scene(sensor=Sensor(noise=3.0, blur=0.0))
    renderer = UnifiedRenderer(World(scene))
    ideal = 255.0 * renderer.render(scene.start_joints)
    photo = renderer.photograph(scene.start_joints, np.random.default_rng(5)).astype(float)
    residual = (photo - ideal)[ideal > 40.0]  # clipping at 0 would bias the dark ones
    assert abs(residual.mean()) < 0.03
    assert residual.std() == pytest.approx(np.hypot(3.0, 1 / np.sqrt(12)), rel=0.02)


def test_blur_spreads_a_dot_without_moving_it_or_losing_light(make_scene):
    sharp = UnifiedRenderer(World(make_scene(sensor=Sensor(noise=0.0, blur=0.0))))
    soft = UnifiedRenderer(World(make_scene(sensor=Sensor(noise=0.0, blur=1.0))))
    q = make_scene().start_joints
    none = np.random.default_rng(0)
    windows = [r.photograph(q, none)[235:275, 297:337].astype(float) for r in (sharp, soft)]
    assert windows[1].min() > windows[0].min()
    assert windows[1].mean() == pytest.approx(windows[0].mean(), rel=2e-3)
    rows, columns = np.indices(windows[0].shape)
    centres = [
        [(w.max() - w).ravel() @ axis.ravel() / (w.max() - w).sum() for axis in (rows, columns)]
        for w in windows
    ]
    np.testing.assert_allclose(centres[0], centres[1], atol=0.3)


def test_photograph_is_determined_by_joints_and_noise_source(make_scene, wall_renderer):
    q = make_scene().start_joints
    first, second = (wall_renderer.photograph(q, np.random.default_rng(11)) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert first.dtype == np.uint8
    assert first.shape == (432, 659)
