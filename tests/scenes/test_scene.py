"""The scene's values refuse what cannot stand in a world."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.robots import Arm
from omniservo.scenes import Ball, Dots, Light, Scene, SceneBox, Sensor

HERE = RigidTransform.identity()


@pytest.mark.parametrize("extents", [[0.1, 0.1, 0.0], [0.1, -0.1, 0.1], [0.1, np.nan, 0.1], [0.1, 0.1]])
def test_box_without_volume_is_refused(extents):
    with pytest.raises(InputError, match="box 'post': half"):
        SceneBox("post", HERE, extents)


def test_corners_of_a_turned_box_lie_where_they_should():
    quarter = RigidTransform.from_components(
        [1, 2, 3], RigidTransform.identity().rotation.from_rotvec([0, 0, np.pi / 2])
    )
    corners = SceneBox("post", quarter, [0.1, 0.2, 0.3]).corners
    np.testing.assert_allclose(corners.min(axis=0), [0.8, 1.9, 2.7], atol=1e-12)
    np.testing.assert_allclose(corners.max(axis=0), [1.2, 2.1, 3.3], atol=1e-12)
    assert len(np.unique(corners.round(9), axis=0)) == 8


def test_ball_of_radius_zero_is_refused():
    with pytest.raises(InputError, match="ball 'knob': radius"):
        Ball("knob", [0, 0, 0], 0.0)


def test_colour_outside_the_unit_cube_is_refused():
    with pytest.raises(InputError, match="between 0 and 1"):
        Ball("knob", [0, 0, 0], 0.1, colour=(255, 0, 0))


def test_dots_need_one_normal_each_and_of_some_length():
    with pytest.raises(InputError, match="normals"):
        Dots([[0, 0, 1.0], [0, 1, 1]], [[0, 0, -1.0]], 0.01)
    with pytest.raises(InputError, match="normal 1 has length 0"):
        Dots([[0, 0, 1.0], [0, 1, 1]], [[0, 0, -1.0], [0, 0, 0]], 0.01)


def test_normals_become_unit_and_arrays_read_only():
    dots = Dots([[0, 0, 1.0]], [[0, 0, -7.0]], 0.01)
    np.testing.assert_array_equal(dots.normals, [[0, 0, -1]])
    with pytest.raises(ValueError, match="read-only"):
        dots.centers[0, 0] = 1.0


def test_of_lights_that_begin_at_one_time_the_last_shines_whichever_is_brighter():
    for first, last in ((1.0, 0.5), (0.5, 1.0)):
        scene = make_scene(lights=(Light(brightness=first), Light(brightness=last)))
        assert scene.light_at(0.0).brightness == last
    with pytest.raises(InputError, match="lights: one since 0 s"):
        make_scene(lights=(Light(), Light(since=2.0), Light(since=1.0)))


@pytest.mark.parametrize(
    "bad",
    [
        *({"rate": 0}, {"latency": -0.1}, {"noise": np.nan}, {"blur": np.inf}, {"readout": np.nan}),
        *({"exposure": -1}, {"exposure": 0.1}, {"gain": -1}, {"vignetting": 1.1}, {"defocus": np.inf}),
        *({"jpeg": 0}, {"jpeg": 80.5}, {"latency": 0.01, "readout": 0.03}),
    ],
)
def test_impossible_sensor_is_refused(bad):
    with pytest.raises(InputError, match=f"sensor: {next(iter(bad))}"):
        Sensor(**bad)


def make_scene(**changes):
    joints = np.deg2rad([-0.7, 43.2, -64.6, 0.8, 111.4, 0.3])
    values = {"arm": Arm.rx60(), "world_T_base": HERE, "flange_T_camera": HERE, "camera": preset("fe185")}
    return Scene(**(values | {"start_joints": joints} | changes))


def test_start_outside_the_joint_range_is_refused():
    with pytest.raises(InputError, match="leave the arm's range"):
        make_scene(start_joints=np.deg2rad([0, 0, 0, 0, 121, 0]))


def test_two_bodies_of_one_name_are_refused():
    twins = (SceneBox("post", HERE, [0.1, 0.1, 0.1]), Ball("post", [0, 0, 0], 0.1))
    with pytest.raises(InputError, match="'post' is given twice"):
        make_scene(obstacles=twins)


def test_joints_for_a_camera_pose_put_the_camera_there():
    scene = make_scene()
    ahead = scene.world_T_camera(scene.start_joints) * RigidTransform.from_translation([0.02, -0.03, 0.05])
    joints = scene.joints_for(ahead, scene.start_joints)
    np.testing.assert_allclose(scene.world_T_camera(joints).as_matrix(), ahead.as_matrix(), atol=1e-9)


@pytest.mark.parametrize("length", [1e-200, 1.0, 1e200])
def test_a_lamp_shines_from_its_direction_however_long_that_is_stated(length):
    light, normals = Light(direction=(0.0, 0.6 * length, 0.8 * length)), np.eye(3)
    np.testing.assert_allclose(light.share(normals), 0.68 + 0.32 * np.array([0.0, 0.6, 0.8]), rtol=1e-12)
    with pytest.raises(InputError, match="its length must not be 0"):
        Light(direction=(0.0, 0.0, 0.0))
