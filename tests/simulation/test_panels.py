"""Printed pictures in the camera's image: against a dense sampling of their own, and against projection."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.scenes import Ball, Light, Panel
from omniservo.simulation import OutsideView, UnifiedRenderer, Viewpoint, World

RNG = np.random.default_rng(8)
CELLS = np.kron(np.pad(RNG.integers(0, 2, (6, 6)), 1), np.ones((4, 4))).astype(float)
NOISE = RNG.uniform(0, 1, (700, 500))
SIZE = np.array([0.12, 0.10])


def panel(picture, rotation=(0.0, 0.0, 0.0), center=(0.0, 0.0, 0.3), size=SIZE):
    """Pose in the frame of the camera at the start, size and picture."""
    return RigidTransform.from_components(center, Rotation.from_rotvec(rotation)), size, picture


@pytest.fixture(scope="module")
def picture_of(make_scene, fisheye):
    """Render panels alone; returns the image as reflectance and the camera."""

    def render(*panels, camera=fisheye, **more):
        base = make_scene()
        world_T_camera = base.world_T_camera(base.start_joints)
        placed = tuple(
            Panel(f"panel {i}", world_T_camera * pose, size, picture)
            for i, (pose, size, picture) in enumerate(panels)
        )
        scene = make_scene(camera=camera, panels=placed, boards=(), dots=None, floor=None, **more)
        image = UnifiedRenderer(World(scene)).render(base.start_joints)
        face = placed[0].world_T_panel.rotation.apply([[0.0, 0.0, -1.0]])
        return image / Light().share(face)

    return render


def sampled(camera, given, rows, columns, per_side=40):
    """The mean grey of each pixel by plain sampling: unprojection, plane, nearest picture element."""
    pose, size, picture = given
    steps = (np.arange(per_side) + 0.5) / per_side - 0.5
    v, u, dv, du = np.meshgrid(rows, columns, steps, steps, indexing="ij", sparse=True)
    bearings, _ = camera.unproject(np.stack(np.broadcast_arrays(u + du, v + dv), axis=-1).reshape(-1, 2))
    origin = pose.inv().translation
    rays = bearings @ pose.rotation.as_matrix()
    points = origin[:2] - origin[2] / rays[:, 2:] * rays[:, :2]
    shape = np.array(picture.shape[::-1])
    column, row = np.clip(np.floor((points / size + 0.5) * shape), 0, shape - 1).astype(int).T
    return picture[row, column].reshape(len(rows), len(columns), -1).mean(axis=-1)


def inner_window(camera, given, margin=2, longest=40):
    """Rows and columns of a rectangle of pixels that lies wholly on a panel."""
    pose, size, _ = given
    grid = np.linspace(-0.35, 0.35, 5)
    spread = np.stack([*np.meshgrid(grid * size[0], grid * size[1]), np.zeros((5, 5))], axis=-1).reshape(
        -1, 3
    )
    pixels, _ = camera.project(pose.apply(spread))
    center = camera.project(pose.translation)[0]
    half = np.abs(pixels - center).max(axis=0) / 2 - margin
    half = np.minimum(half, longest / 2)
    low, high = np.ceil(center - half).astype(int), np.floor(center + half).astype(int)
    return np.arange(low[1], high[1] + 1), np.arange(low[0], high[0] + 1)


VIEWS = {
    "squarely": panel(CELLS),
    "slanted": panel(CELLS, (0.7, -0.4, 0.5), (0.03, -0.02, 0.2)),
    "at the rim": panel(CELLS, (0.1, 1.2, 0.2), (0.25, 0.03, 0.06)),
    "far": panel(CELLS, (0.3, 0.2, 0.8), (0.1, 0.0, 0.55), 2 * SIZE),
    "with detail finer than a pixel": panel(NOISE, (0.2, 0.3, 0.4), (0.02, 0.0, 0.35), 2 * SIZE),
}


@pytest.mark.parametrize("view", VIEWS)
def test_each_pixel_shows_the_mean_of_the_picture_over_its_square(picture_of, fisheye, view):
    """An edge of contrast 1 that lay d px off would change a pixel by d."""
    rows, columns = inner_window(fisheye, VIEWS[view])
    assert len(rows) >= 6
    assert len(columns) >= 6
    image = picture_of(VIEWS[view])[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    expected = sampled(fisheye, VIEWS[view], rows, columns)
    error = image - expected
    assert np.abs(error).max() < 0.04
    assert np.sqrt((error**2).mean()) < 0.008
    assert expected.std() > 0.02


@pytest.mark.parametrize("xi", [0.0, 0.9, 1.291, 2.0])
def test_printed_edge_lies_on_the_projected_line(picture_of, xi):
    camera = UnifiedCamera(200 * (1 + xi), 200 * (1 + xi), 160, 120, xi, 320, 240)
    half_black = np.repeat([[0.0, 1.0]], 3, axis=0)
    pose, size, picture = panel(half_black, (0.3, 0.5, 0.2), (0.02, 0.0, 0.3), (0.3, 0.3))
    image = picture_of((pose, size, picture), camera=camera)
    along = np.linspace(-0.15, 0.15, 4001)
    line = camera.project(pose.apply(np.stack([0 * along, along, 0 * along], axis=-1)))[0]
    errors = []
    for row in range(70, 170):
        expected = np.interp(row, line[:, 1], line[:, 0])
        first = int(expected) - 8
        dark = (1.0 - image[row, first : first + 17]).sum()
        errors.append(first - 0.5 + dark - expected)
    assert np.abs(errors).max() < 0.02
    assert abs(np.mean(errors)) < 0.005


def test_a_linear_ramp_shows_the_place_that_each_pixel_looks_at(picture_of, fisheye):
    ramp = np.tile((np.arange(2000) + 0.5) / 2000, (3, 1))
    pose, size, _ = given = panel(ramp, (0.4, 0.3, -0.2))
    rows, columns = inner_window(fisheye, given)
    v, u = np.meshgrid(rows, columns, indexing="ij")
    bearings, _ = fisheye.unproject(np.stack([u, v], axis=-1).astype(float))
    rays, origin = bearings @ pose.rotation.as_matrix(), pose.inv().translation
    x = origin[0] - origin[2] * rays[..., 0] / rays[..., 2]
    seen = picture_of(given)[v, u]
    step = np.abs(np.diff(seen, axis=1)).mean()  # grey of one pixel
    assert np.abs(seen - (x / size[0] + 0.5)).max() < 0.01 * step


def test_a_sine_is_damped_as_the_mean_over_a_pixel_damps_it(picture_of):
    camera = UnifiedCamera(400, 400, 160, 120, 0.0, 320, 240)
    for wavelength in (8.0, 2.5, 0.7):  # px; the panel is 160 px wide
        phase = 2 * np.pi * (np.arange(4000) + 0.5) / 4000 * 160 / wavelength
        picture = np.tile(0.5 + 0.5 * np.cos(phase), (2, 1))
        image = picture_of(panel(picture, size=(0.12, 0.12)), camera=camera)
        u = np.arange(100, 220)
        damped = np.sinc(1 / wavelength) * 0.5 * np.cos(2 * np.pi * (u - 80) / wavelength)
        np.testing.assert_allclose(image[120, u] - 0.5, damped, atol=2e-3)


def test_picture_is_upright_and_not_mirrored(picture_of, fisheye):
    corners = np.array([[0.1, 0.3], [0.9, 0.6]])  # top left, top right; bottom left, bottom right
    image = picture_of(panel(corners))
    v, u = np.rint(fisheye.project([0, 0, 0.3])[0]).astype(int)[::-1]
    seen = [[image[v - 8, u - 8], image[v - 8, u + 8]], [image[v + 8, u - 8], image[v + 8, u + 8]]]
    np.testing.assert_allclose(seen, corners, atol=1e-9)


def test_panel_is_blank_from_behind_and_hidden_by_what_is_nearer(picture_of, make_scene, fisheye):
    behind = picture_of(panel(CELLS, (0.0, np.pi, 0.0)))
    v, u = np.rint(fisheye.project([0, 0, 0.3])[0]).astype(int)[::-1]
    assert np.ptp(behind[v - 10 : v + 11, u - 10 : u + 11]) < 1e-12
    base = make_scene()
    ahead = base.world_T_camera(base.start_joints).apply([0, 0, 0.2])
    hidden = picture_of(panel(CELLS), obstacles=(Ball("knob", ahead, 0.02, colour=(0, 0, 0)),))
    assert hidden[v, u] == 0.0


def test_outline_of_a_panel_is_sub_pixel(picture_of, fisheye):
    given = panel(np.ones((2, 2)), (0.0, 0.0, 0.05), size=(0.08, 0.2))
    pose, image = given[0], picture_of(given)
    left, right = (
        fisheye.project(pose.apply([[x, y, 0.0] for y in np.linspace(-0.1, 0.1, 2001)]))[0]
        for x in (-0.04, 0.04)
    )
    for row in range(235, 275, 3):
        low, high = (np.interp(row, line[:, 1], line[:, 0]) for line in (left, right))
        middle = int((low + high) / 2)
        outside = image[row, int(low) - 4]
        covered = (image[row, int(low) - 4 : middle] - outside) / (image[row, middle] - outside)
        assert middle - 0.5 - covered.sum() == pytest.approx(low, abs=0.03)


def test_bystander_sees_the_picture_where_a_pinhole_camera_would(make_scene):
    pose = RigidTransform.from_components([2.0, 0.0, 0.2], Rotation.from_euler("x", -90, degrees=True))
    picture = np.repeat(np.repeat([[0.0, 1.0], [1.0, 0.0]], 2, axis=0), 2, axis=1)
    printed = Panel("print", pose, [0.6, 0.4], picture)
    away = RigidTransform.from_translation([0, 50, 0])
    world = World(make_scene(boards=(), dots=None, panels=(printed,), world_T_base=away))
    view = Viewpoint(eye=(2.0, -2.0, 0.2), focus=(2.0, 0.0, 0.2))
    seen = OutsideView(world, view, width=120, height=90, shadow_rays=0).render(world.scene.start_joints)
    grey = seen.astype(int).sum(axis=-1)
    focal = 45 / np.tan(view.field_of_view / 2)
    right, down = 0.15 / 2 * focal, 0.1 / 2 * focal
    quarters = [[grey[round(44.5 + y), round(59.5 + x)] for x in (-right, right)] for y in (-down, down)]
    assert quarters[0][0] < 150 < 450 < quarters[0][1]
    assert quarters[1][1] < 150 < 450 < quarters[1][0]


def test_corners_run_round_the_picture_from_its_top_left():
    here = Panel("print", RigidTransform.identity(), [0.4, 0.2], [[0.5]])
    np.testing.assert_allclose(
        here.corners, [[-0.2, -0.1, 0], [0.2, -0.1, 0], [0.2, 0.1, 0], [-0.2, 0.1, 0]], atol=1e-15
    )


@pytest.mark.parametrize(
    ("size", "picture", "says"),
    [
        ((0.1, 0.0), [[0.5]], "size 0 m given"),
        ((0.1, np.nan), [[0.5]], "every number must be finite"),
        ((0.1, 0.1), [0.5], "picture: shape"),
        ((0.1, 0.1), [[1.5]], "between 0 and 1"),
        ((0.1, 0.1), np.zeros((0, 3)), "at least one"),
    ],
)
def test_impossible_panels_are_refused_by_name(size, picture, says):
    with pytest.raises(InputError, match="panel 'print'") as refusal:
        Panel("print", RigidTransform.identity(), size, picture)
    assert says in str(refusal.value)


def test_panels_cannot_be_touched_or_altered(make_scene):
    base = make_scene()
    through = Panel("print", base.world_T_camera(base.start_joints), [0.5, 0.5], np.ones((2, 2)))
    world = World(make_scene(panels=(through,)))
    assert not world.touching(world.data_at(base.start_joints))
    with pytest.raises(ValueError, match="read-only"):
        through.picture[0, 0] = 0.0
    with pytest.raises(InputError, match="given twice"):
        make_scene(panels=(through, through))
