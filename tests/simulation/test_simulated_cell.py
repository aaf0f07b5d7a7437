"""The cell of a task in the simulator: arm, camera, what may be moved, and the truth about it."""

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.robots import ArmDriver, CameraSource, next_image
from omniservo.simulation import SimulatedCell
from omniservo.tasks import load_task


@pytest.fixture(scope="module")
def task():
    return load_task("paper-example-1")


@pytest.fixture(scope="module")
def shared(task):
    return SimulatedCell(task)


@pytest.fixture
def cell(shared):
    shared.bring_arm_to(shared.scene.start_joints)
    shared.robot.rearrange(shared.scene.obstacles)
    return shared


def test_it_has_an_arm_and_a_camera_on_one_clock(cell):
    assert isinstance(cell.driver, ArmDriver)
    assert isinstance(cell.camera, CameraSource)
    cell.wait(0.05)
    assert cell.driver.read().time == pytest.approx(0.05)
    assert 0.0 <= cell.camera.image().time <= 0.05


def test_the_arm_is_brought_where_it_is_to_be_and_nowhere_else(cell):
    joints = cell.scene.start_joints + 0.05
    cell.bring_arm_to(joints)
    np.testing.assert_array_equal(cell.driver.read().joint_positions, joints)
    with pytest.raises(InputError, match="leave the arm's range"):
        cell.bring_arm_to(joints + 10.0)


def test_one_obstacle_is_moved_by_what_was_said_and_the_others_stay(cell):
    before = cell.robot.world.scene
    cell.move_obstacles([0], np.array([0.1, -0.2, 0.3]))
    after = cell.robot.world.scene
    moved = after.obstacles[0].world_T_box.translation - before.obstacles[0].world_T_box.translation
    np.testing.assert_allclose(moved, [0.1, -0.2, 0.3], atol=1e-12)
    assert after.obstacles[1:] == before.obstacles[1:]
    assert cell.scene.obstacles == before.obstacles


def test_what_stands_between_camera_and_point_hides_it_by_its_name(cell, task):
    joints = cell.scene.start_joints
    eye = cell.scene.world_T_camera(joints).translation
    box = cell.scene.obstacles[0].world_T_box.translation
    behind, before = eye + 2.0 * (box - eye), eye + 0.2 * (box - eye)
    assert cell.truth.hidden_by(joints, np.array([behind, before])) == ["obstacle 0", None]
    cell.move_obstacles([0], np.array([0.0, 0.0, 5.0]))
    assert cell.truth.hidden_by(joints, np.array([behind]))[0] != "obstacle 0"


def test_what_a_pixel_shows_lies_on_its_ray(cell, task):
    joints = cell.scene.start_joints
    centers = task.start.world_T_camera.transform.apply([dot.center for dot in task.target.dots])
    pixels, _ = task.camera.project(cell.scene.world_T_camera(joints).inv().apply(centers))
    np.testing.assert_allclose(cell.truth.points_under(joints, pixels), centers, atol=1e-4)


def test_a_pixel_that_shows_nothing_has_no_point(cell, task):
    """Straight up, where nothing stands, and outside the lens."""
    joints = cell.scene.start_joints
    up, valid = task.camera.project(cell.scene.world_T_camera(joints).rotation.inv().apply([0.0, 0.0, 1.0]))
    assert valid
    assert np.isnan(cell.truth.points_under(joints, np.array([up, [-1e4, -1e4]]))).all()


def test_the_cameras_true_pose_is_that_of_the_exposure(cell):
    cell.driver.command([0.3, 0, 0, 0, 0, 0])
    image = next_image(cell.camera, cell.wait)
    cell.wait(0.1)
    exposed, now = cell.truth.world_T_camera(image.time), cell.robot.world_T_camera()
    assert np.linalg.norm(exposed.translation - now.translation) > 1e-3


@pytest.mark.slow
def test_a_picture_from_outside_shows_obstacles_where_they_were_then_or_are_now(cell):
    joints = cell.scene.start_joints
    before = next_image(cell.camera, cell.wait)
    first = cell.truth.outside_picture(joints, quick=True)
    cell.move_obstacles([0], np.array([0.0, 0.0, 0.3]))
    after = next_image(cell.camera, cell.wait)
    np.testing.assert_array_equal(cell.truth.outside_picture(joints, before.time, quick=True), first)
    moved = cell.truth.outside_picture(joints, after.time, quick=True)
    assert (moved != first).any()
    np.testing.assert_array_equal(cell.truth.outside_picture(joints, quick=True), moved)
    assert cell.truth.outside_picture(joints).shape > moved.shape
