"""Drawn dots in the place of rendered images: the same dots at the same places, without a renderer."""

import time

import numpy as np
import pytest
import yaml
from tests.cli.calling import call

from omniservo.errors import InputError
from omniservo.perception import find_dots
from omniservo.scenes import scene_of_task
from omniservo.simulation import RealTimeRobot, SimulatedRobot
from omniservo.simulation.projected_dots import ProjectedDots
from omniservo.tasks import load_robot, load_task


@pytest.fixture(scope="module")
def scene():
    return scene_of_task(load_task("paper-example-1"))


def nearest(found, pixels):
    return np.array([np.linalg.norm(found - pixel, axis=1).min() for pixel in pixels])


def test_drawn_dots_are_where_rendered_ones_are_and_as_large(scene):
    robot = SimulatedRobot(scene)
    robot.advance(0.2)
    exposure = robot.newest_exposure()
    drawn, rendered = find_dots(ProjectedDots(scene).drawn(exposure)), find_dots(robot.image().pixels)
    assert len(drawn.pixels) == len(rendered.pixels) == len(scene.dots.centers)
    assert nearest(drawn.pixels, rendered.pixels).max() < 0.06
    np.testing.assert_allclose(sorted(drawn.area_px), sorted(rendered.area_px), rtol=0.02)
    pixels, _ = scene.camera.project(scene.world_T_camera(exposure.joints).inv().apply(scene.dots.centers))
    assert nearest(drawn.pixels, pixels).max() < 0.15  # a disc's centre and its image's centroid differ


def test_dots_that_face_away_or_lie_outside_are_not_drawn(scene):
    robot = SimulatedRobot(scene)
    robot.advance(0.2)
    dots = ProjectedDots(scene)
    dots._normals = -dots._normals
    assert len(np.unique(dots.drawn(robot.newest_exposure()))) == 1


def test_the_robot_on_the_wall_clock_sends_them(scene):
    robot = RealTimeRobot(scene, projected=True)
    try:
        end = time.monotonic() + 60.0
        while (image := robot.image()) is None:
            assert time.monotonic() < end
        assert len(find_dots(image.pixels).pixels) == len(scene.dots.centers)
    finally:
        robot.close()


def test_a_target_without_dots_is_refused():
    with pytest.raises(InputError, match="--projected: the target has no dots"):
        ProjectedDots(scene_of_task(load_task("tag-board")))


def served(tmp_path, capsys, *options):
    """Serve for no time at all; return the robot file."""
    robot = tmp_path / "robot.yaml"
    code, _, err = call(
        capsys, "sim", "serve", "paper-example-1", "--free-ports", "--projected", "--seconds", "0",
        "--robot-file", robot, "--quiet", *options,
    )  # fmt: skip
    return code, err, robot


def test_a_smaller_image_is_of_the_same_lens(tmp_path, capsys):
    code, _, robot = served(tmp_path, capsys, "--size", "330x216", "--rate", "7")
    assert code == 0
    small, large = load_robot(robot).camera.calibration, load_task("paper-example-1").camera
    assert (small.width, small.height) == (330, 216)
    assert yaml.safe_load(robot.read_text())["camera"]["rate"] == 7.0
    points = np.array([[0.1, 0.05, 1.0], [-0.3, 0.2, 0.9], [0.0, 0.0, 1.0]])
    share = np.array([330 / large.width, 216 / large.height])
    edges = large.project(points)[0] + 0.5  # from the image's corner
    np.testing.assert_allclose(small.project(points)[0] + 0.5, share * edges, atol=1e-9)


@pytest.mark.parametrize("size", ["330x300", "1318x864", "0x0"])
def test_a_size_of_another_camera_is_refused(tmp_path, capsys, size):
    code, err, robot = served(tmp_path, capsys, "--size", size)
    assert code == 2
    assert f"--size: {size} given; legal: at most 659x432" in err
    assert not robot.exists()
