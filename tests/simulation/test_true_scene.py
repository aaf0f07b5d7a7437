"""What only the simulator knows: another lens than the one that is told, and lights that change."""

import re
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omniservo
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import camera_from_dict
from omniservo.errors import InputError
from omniservo.scenes import LensError, Light, Sensor
from omniservo.simulation import SimulatedCell, SimulatedRobot, UnifiedRenderer, World, take_picture
from omniservo.simulation.true_lens import TrueLens
from omniservo.tasks import load_task
from omniservo.tasks.simulation import LensErrorSection, LightChange, LightSection, SimulationSection

TOLD = UnifiedCamera(300.0, 300.0, 79.5, 59.5, 0.8, 160, 120)
OTHER = camera_from_dict(
    {
        "model": "kannala_brandt",
        "fx": 160.0, "fy": 160.0, "cx": 82.0, "cy": 58.0, "k": [0.01, 0.0, 0.0, 0.0],
        "width": 160, "height": 120,
    }
)  # fmt: skip
QUIET = Sensor(noise=0.0, blur=0.0, rate=10, latency=0.0)
DIM = Light(brightness=0.5)


def dot_places(scene, lens):
    """Pixels (n, 2) of the scene's dots through a lens, those in the image."""
    camera_T_world = scene.world_T_camera(scene.start_joints).inv()
    pixels, valid = lens.project(camera_T_world.apply(scene.dots.centers))
    inside = valid & (pixels > 15).all(axis=1) & (pixels < [144, 104]).all(axis=1)
    return pixels, inside


def darkest(image, pixel):
    """Centre of the darkness round a pixel."""
    column, row = np.rint(pixel).astype(int)
    window = image[row - 9 : row + 10, column - 9 : column + 10]
    dark = np.maximum(window[0, 0] - window, 0.0)
    return np.array([column, row]) + np.array([dark.sum(0), dark.sum(1)]) @ np.arange(-9, 10) / dark.sum()


def test_pictures_are_those_of_the_true_camera(make_scene):
    scene = make_scene(camera=TOLD, true_camera=OTHER, sensor=QUIET)
    image = UnifiedRenderer(World(scene)).render(scene.start_joints)
    places, inside = dot_places(scene, OTHER)
    told, _ = dot_places(scene, TOLD)
    assert inside.sum() >= 3
    assert np.linalg.norm(told - places, axis=1)[inside].max() > 2.0
    for pixel in places[inside]:
        assert np.linalg.norm(darkest(image, pixel) - pixel) < 0.3


def test_a_lens_error_displaces_the_picture_by_its_field(make_scene):
    error = LensError(sigma=1.5, length=40.0, seed=3)
    scene = make_scene(camera=TOLD, sensor=QUIET)
    planted = replace(scene, lens_error=error)
    plain, moved = (UnifiedRenderer(World(s)).render(s.start_joints) for s in (scene, planted))
    places, inside = dot_places(scene, TOLD)
    moves = [darkest(moved, p + error.at(p)) - darkest(plain, p) for p in places[inside]]
    np.testing.assert_allclose(moves, error.at(places[inside]), atol=0.25)
    assert np.linalg.norm(moves, axis=1).max() > 0.8


def test_a_lens_error_has_the_stated_size_and_is_alike_over_the_stated_length():
    at = np.stack(np.meshgrid(np.arange(0, 640, 16.0), np.arange(0, 480, 16.0)), axis=-1)
    fields = np.array([LensError(0.3, 128.0, seed).at(at) for seed in range(60)])
    assert fields.std() == pytest.approx(0.3, rel=0.05)
    apart = (fields[:, :, 8:] * fields[:, :, :-8]).mean() / (fields**2).mean()  # 128 px
    assert apart == pytest.approx(np.exp(-0.5), abs=0.06)
    assert abs(np.corrcoef(fields[..., 0].ravel(), fields[..., 1].ravel())[0, 1]) < 0.1


def test_the_lens_error_of_a_large_image_takes_little_memory():
    pixels = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1)
    error = LensError(0.3, 128.0)
    tracemalloc.start()
    error.at(pixels)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 10 * pixels.nbytes


def test_the_true_lens_sees_what_the_model_has_where_the_pixel_came_from(make_scene):
    error = LensError(0.5, 40.0)
    lens = TrueLens(make_scene(camera=TOLD, true_camera=OTHER, lens_error=error))
    pixels = np.array([[30.0, 40.0], [80.0, 60.0]])
    np.testing.assert_array_equal(lens.unproject(pixels)[0], OTHER.unproject(pixels - error.at(pixels))[0])


def test_a_changed_light_changes_intensities_and_no_geometry(make_scene):
    scene = make_scene(camera=TOLD, sensor=QUIET)
    renderer = UnifiedRenderer(World(scene))
    q = scene.start_joints
    plain, dim = renderer.render(q), renderer.render(q, DIM)
    turned = renderer.render(q, Light(ambient=0.3, direction=(-1.0, 0.0, 0.0)))
    lit = renderer._lit & ~renderer._rim
    np.testing.assert_allclose(dim[lit], 0.5 * plain[lit], rtol=1e-9)
    assert np.abs(turned - plain).max() > 0.05
    places, inside = dot_places(scene, TOLD)
    for pixel in places[inside]:
        np.testing.assert_allclose(darkest(turned, pixel), darkest(plain, pixel), atol=1e-3)


def test_lights_shine_one_after_the_other(make_scene):
    lights = (Light(), Light(since=0.25, brightness=0.5), Light(since=0.45, brightness=0.8))
    robot = SimulatedRobot(make_scene(camera=TOLD, sensor=QUIET, lights=lights))
    brightness = []
    for _ in range(6):
        brightness.append(float(robot.image().pixels.mean()))
        robot.advance(0.1)
    shares = np.array(brightness) / brightness[0]
    np.testing.assert_allclose(shares, [1, 1, 1, 0.5, 0.5, 0.8], atol=0.03)


@pytest.mark.parametrize("lights", [(), (Light(since=1.0),), (Light(), Light(since=2.0), Light(since=1.0))])
def test_lights_out_of_order_are_refused(make_scene, lights):
    with pytest.raises(InputError, match="lights: one since 0 s"):
        make_scene(lights=lights)


def test_a_true_camera_of_another_size_is_refused(make_scene, fisheye):
    with pytest.raises(InputError, match="true_camera: 659 × 432 px given; camera has 160 × 120 px"):
        make_scene(camera=TOLD, true_camera=fisheye)


@pytest.fixture(scope="module")
def planted():
    task = load_task("perspective-wall")
    camera = replace(task.camera, cx=task.camera.cx + 3.0)
    return task.model_copy(
        update={
            "simulation": SimulationSection(
                true_camera=camera,
                lens_error=LensErrorSection(sigma=0.3),
                goal_light=LightSection(brightness=0.5),
                light_changes=(LightChange(time=1.0, brightness=0.7),),
            )
        }
    )


@pytest.mark.slow
def test_a_cell_tells_the_camera_and_takes_pictures_with_the_true_one(planted):
    cell, plain = (
        SimulatedCell(planted),
        SimulatedCell(planted.model_copy(update={"simulation": SimulationSection()})),
    )
    told = cell.scene
    assert (told.camera, told.true_camera, told.lens_error, told.lights) == (
        planted.camera,
        None,
        None,
        (Light(),),
    )
    truth = cell.robot.world.scene
    assert truth.true_camera == planted.simulation.true_camera
    assert truth.lens_error == LensError(0.3, 0.2 * planted.camera.width)
    pictures = [take_picture(c.robot).pixels.astype(int) for c in (cell, plain)]
    assert np.abs(pictures[0] - pictures[1]).max() > 50


def test_only_the_simulator_and_who_reads_tasks_know_of_what_is_true():
    knowing = {"scenes/scene.py", "scenes/lens_error.py", "scenes/__init__.py", "tasks/task.py"}
    knowing |= {"tasks/simulation.py", "tasks/load_task.py", "simulation/true_scene.py"}
    knowing |= {"simulation/true_lens.py", "simulation/simulated_cell.py"}
    knowing |= {"simulation/sim_server.py", "simulation/projected_dots.py", "cli/sim.py"}  # serve the truth
    knowing |= {"runs/on_robot.py"}  # drops it: there is none on a real robot
    knowing |= {"tasks/save_task.py", "schemas/task_schema.py"}  # what a task's file says
    package = Path(omniservo.__file__).parent
    words = re.compile(r"true_camera|lens_error|\.simulation\b(?!\.)|goal_light")
    found = {
        file.relative_to(package).as_posix()
        for file in package.rglob("*.py")
        if words.search(
            re.sub(r"(from|import) omniservo\.simulation|omniservo\.simulation", "", file.read_text())
        )
    }
    assert found <= knowing


@pytest.mark.slow
def test_the_goal_is_taught_in_its_own_light(planted):
    cell = SimulatedCell(planted)
    start = take_picture(cell.robot).pixels.mean()
    cell.bring_arm_to(cell.scene.start_joints)
    assert take_picture(cell.robot).pixels.mean() == pytest.approx(0.5 * start, rel=0.05)
