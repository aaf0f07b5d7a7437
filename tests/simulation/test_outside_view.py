"""The bystander's picture: perspective, colours, shadows."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.scenes import Ball, SceneBox
from omniservo.simulation import OutsideView, Viewpoint, World

VIEW = Viewpoint(eye=(2.0, -2.0, 1.0), focus=(2.0, 0.0, 0.0))
SMALL = {"width": 120, "height": 90}
FAR_AWAY = RigidTransform.from_translation([0, 50, 0])


def pixel_of(view, point, width, height):
    """Independent pinhole projection of a world point."""
    forward = np.subtract(view.focus, view.eye)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    x, y, z = (np.dot(axis, np.subtract(point, view.eye)) for axis in (right, down, forward))
    focal = height / 2 / np.tan(view.field_of_view / 2)
    return focal * x / z + (width - 1) / 2, focal * y / z + (height - 1) / 2


def test_ball_appears_where_a_pinhole_camera_sees_it(make_scene):
    place = (2.2, 0.1, 0.15)
    ball = Ball("knob", place, 0.08, colour=(0.9, 0.0, 0.0))
    world = World(make_scene(boards=(), dots=None, obstacles=(ball,), world_T_base=FAR_AWAY))
    picture = OutsideView(world, VIEW, shadow_rays=0, **SMALL).render(world.scene.start_joints).astype(int)
    red = picture[..., 0] - picture[..., 2] > 60
    rows, columns = np.nonzero(red)
    np.testing.assert_allclose([columns.mean(), rows.mean()], pixel_of(VIEW, place, 120, 90), atol=0.7)


def test_lamp_throws_a_shadow_on_the_floor(make_scene):
    ball = Ball("knob", (2.0, 0.0, 0.3), 0.12)
    world = World(make_scene(boards=(), dots=None, obstacles=(ball,), floor=0.0, world_T_base=FAR_AWAY))
    q = world.scene.start_joints
    bare, shaded = (
        OutsideView(world, VIEW, shadow_rays=n, **SMALL).render(q).astype(int).sum(-1) for n in (0, 4)
    )
    darker = bare - shaded
    assert darker.min() >= -30  # a shadow never brightens, but edges of it are sampled anew
    assert 50 < (darker > 60).sum() < 0.2 * darker.size


def test_default_viewpoint_shows_arm_obstacle_and_dots(make_scene):
    block = SceneBox("post", RigidTransform.from_translation([0.45, -0.3, 0.5]), [0.05] * 3, colour=(0, 0, 1))
    world = World(make_scene(obstacles=(block,)))
    view = Viewpoint.beside(world)
    scene = world.scene
    shown = [
        scene.world_T_base.translation,
        *scene.dots.centers,
        scene.world_T_camera(scene.start_joints).translation,
    ]
    for point in shown:
        u, v = pixel_of(view, point, 640, 480)
        assert 0 < u < 640
        assert 0 < v < 480
    picture = OutsideView(world, view, **SMALL, shadow_rays=1).render(scene.start_joints).astype(int)
    yellow = (picture[..., 0] > 120) & (picture[..., 2] < 100)
    blue = (picture[..., 2] > 100) & (picture[..., 0] < 60)
    assert yellow.sum() > 300
    assert blue.sum() > 10


def test_picture_follows_the_arm(make_scene):
    world = World(make_scene())
    view = OutsideView(world, shadow_rays=0, **SMALL)
    q = world.scene.start_joints
    first, moved, again = view.render(q), view.render(q + 0.3 * np.eye(6)[0]), view.render(q)
    assert (first != moved).any()
    np.testing.assert_array_equal(first, again)


@pytest.mark.parametrize("shadow_rays", [0, 1, 3])
def test_a_films_pictures_are_those_that_are_drawn_whole(make_scene, shadow_rays):
    post = SceneBox("post", RigidTransform.from_translation([0.45, -0.3, 0.3]), [0.05] * 3)
    world = World(make_scene(obstacles=(post,)))
    whole, film = (
        OutsideView(world, width=240, height=180, shadow_rays=shadow_rays, films=films)
        for films in (False, True)
    )
    for turn in (0.0, 0.6, -1.0):
        joints = world.scene.start_joints + turn * np.array([1.0, 0.3, -0.5, 0.0, 1.0, 0.0])
        np.testing.assert_array_equal(film.render(joints), whole.render(joints))


def test_impossible_viewpoints_are_refused(make_scene):
    world = World(make_scene())
    with pytest.raises(InputError, match="above each other"):
        OutsideView(world, Viewpoint(eye=(0, 0, 2), focus=(0, 0, 0)))
    with pytest.raises(InputError, match="width"):
        OutsideView(world, width=0)
    with pytest.raises(InputError, match="q"):
        OutsideView(world, **SMALL).render([0, 0, np.nan, 0, 0, 0])
