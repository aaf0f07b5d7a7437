"""The world: the same arm as the kinematics', contacts where bodies overlap, distances against geometry."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.robots import Arm
from omniservo.scenes import Ball, SceneBox
from omniservo.simulation import World


def lens_front(scene):
    """A point 5 mm in front of the camera's centre: the middle of the lens's front."""
    return scene.world_T_camera(scene.start_joints).apply([0, 0, 0.005])


def test_camera_of_the_world_is_where_the_kinematics_say(make_scene):
    scene = make_scene()
    world = World(scene)
    rng = np.random.default_rng(1)
    for q in rng.uniform(*scene.arm.joint_range.T, (20, 6)):
        found = world.world_T_camera(world.data_at(q)).as_matrix()
        np.testing.assert_allclose(found, scene.world_T_camera(q).as_matrix(), atol=1e-12)


def test_arm_in_its_start_joints_touches_nothing(make_scene):
    world = World(make_scene())
    assert world.touching(world.data_at(world.scene.start_joints)) == set()


def test_box_put_into_the_forearm_is_reported(make_scene):
    scene = make_scene()
    elbow = scene.world_T_base * scene.arm.base_T_flange(scene.start_joints)
    middle = elbow.apply([0, 0, -0.065 - 0.05])  # a little behind the wrist
    world = World(
        make_scene(obstacles=(SceneBox("post", RigidTransform.from_translation(middle), [0.02] * 3),))
    )
    touched = world.touching(world.data_at(scene.start_joints))
    assert any("post" in pair for pair in touched)
    assert world.arm_obstacle_distance(world.data_at(scene.start_joints)) < 0.0


def test_board_put_into_the_lens_is_reported_but_is_no_obstacle(make_scene):
    scene = make_scene()
    plate = SceneBox("plate", RigidTransform.from_translation(lens_front(scene)), [0.001, 0.05, 0.05])
    world = World(make_scene(boards=(plate,)))
    data = world.data_at(scene.start_joints)
    assert ("camera", "plate") in world.touching(data)
    assert world.arm_obstacle_distance(data) == 1.0


def test_folded_arm_touches_itself(make_scene):
    world = World(make_scene())
    curled = np.deg2rad([0, 100, 134, 0, 110, 0])
    touched = world.touching(world.data_at(curled))
    links = {"base", "shoulder", "upper_arm", "elbow", "forearm", "wrist", "flange", "camera"}
    assert any(set(pair) <= links for pair in touched)


def test_links_that_share_a_joint_never_count_as_touching(make_scene):
    world = World(make_scene(floor=None, boards=(), dots=None))
    rng = np.random.default_rng(2)
    chain = ["base", "shoulder", "upper_arm", "elbow", "forearm", "wrist", "flange"]
    neighbours = {tuple(sorted(pair)) for gap in (1, 2) for pair in zip(chain, chain[gap:], strict=False)}
    neighbours -= {("base", "upper_arm")}
    for q in rng.uniform(*world.scene.arm.joint_range.T, (60, 6)):
        assert not world.touching(world.data_at(q)) & neighbours


@pytest.mark.parametrize("gap", [0.2, 0.05, 0.003])
def test_distance_to_a_ball_ahead_of_the_lens_is_exact(make_scene, gap):
    scene = make_scene()
    center = scene.world_T_camera(scene.start_joints).apply([0, 0, 0.005 + gap + 0.03])
    world = World(make_scene(obstacles=(Ball("knob", center, 0.03),)))
    assert world.arm_obstacle_distance(world.data_at(scene.start_joints)) == pytest.approx(gap, abs=1e-6)


def test_distance_without_obstacles_is_the_farthest_asked(make_scene):
    world = World(make_scene())
    assert world.arm_obstacle_distance(world.data_at(world.scene.start_joints), farthest=0.4) == 0.4


def test_foot_stands_where_the_scene_puts_it(make_scene):
    turned = RigidTransform.from_components(
        [1, 2, 3], RigidTransform.identity().rotation.from_rotvec([0.1, -0.4, 0.7])
    )
    scene = make_scene(world_T_base=turned, boards=(), dots=None, floor=None)
    world = World(scene)
    q = np.deg2rad([10, 20, 30, 40, 50, 60])
    expected = turned * Arm.rx60().base_T_flange(q) * scene.flange_T_camera
    np.testing.assert_allclose(
        world.world_T_camera(world.data_at(q)).as_matrix(), expected.as_matrix(), atol=1e-12
    )
