"""Pictures of a camera that moves while they are taken: motion blur and rolling shutter."""

import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera
from omniservo.scenes import Sensor
from omniservo.simulation import SimulatedRobot, UnifiedRenderer, World
from omniservo.simulation.exposure_times import exposure_times

SMALL = UnifiedCamera(300.0, 300.0, 79.5, 59.5, 0.8, 160, 120)
SPEED = np.array([0.6, 0.2, -0.3, 0.5, 0.4, 0.6])  # [rad/s]
CLEAN = {"noise": 0.0, "blur": 0.0, "latency": 0.1, "rate": 10}


@pytest.fixture(scope="module")
def renderer(make_scene):
    """Returns the renderer of a sensor, and of the camera's motion."""

    def make(**sensor):
        scene = make_scene(camera=SMALL, sensor=Sensor(**(CLEAN | sensor)))
        return UnifiedRenderer(World(scene)), lambda time: scene.start_joints + time * SPEED

    return make


def test_motion_blur_is_the_mean_of_sharp_pictures_along_the_motion(renderer):
    camera, joints_at = renderer(exposure=0.05)
    sharp = [camera.render(joints_at(t)) for t in (np.arange(40) + 0.5) / 40 * 0.05 - 0.025]
    blurred, mean = camera.expose(joints_at), np.mean(sharp, axis=0)
    assert np.sqrt(np.mean((blurred - mean) ** 2)) < 0.02 * np.sqrt(np.mean((sharp[20] - mean) ** 2))
    assert np.abs(blurred - mean).max() < 0.02


def test_rows_of_a_rolling_shutter_are_those_of_sharp_pictures_at_their_instants(renderer):
    readout = 0.08
    camera, joints_at = renderer(readout=readout)
    rolling, still = camera.expose(joints_at), camera.render(joints_at(0.0))
    errors, changes = [], []
    for row in range(3, 120, 9):
        seen = camera.render(joints_at(((row + 0.5) / 120 - 0.5) * readout))[row]
        errors.append(rolling[row] - seen)
        changes.append(still[row] - seen)
    assert np.sqrt(np.mean(np.square(errors))) < 0.05 * np.sqrt(np.mean(np.square(changes)))
    assert np.abs(errors).max() < 0.1


def test_a_row_whose_instant_is_rendered_is_that_of_the_sharp_picture(renderer, monkeypatch):
    monkeypatch.setattr("omniservo.simulation.unified_renderer._Look.per_side", lambda look, full: full)
    monkeypatch.setattr("omniservo.simulation.unified_renderer.MOVING_STEP", 1e9)  # first and last alone
    camera, joints_at = renderer(readout=0.08)
    rolling = camera.expose(joints_at)
    first, last = (camera.render(joints_at(t)) for t in (-0.04, 0.04))
    weights = (np.arange(120) + 0.5)[:, None] / 120
    np.testing.assert_allclose(rolling, (1 - weights) * first + weights * last, atol=1e-12)


def test_where_rows_lie_farther_apart_than_instants_each_is_seen_once(renderer, monkeypatch):
    monkeypatch.setattr("omniservo.simulation.unified_renderer.MOVING_STEP", 0.05)
    camera, joints_at = renderer(readout=0.08)
    rolling, row = camera.expose(joints_at), 40
    seen = camera.render(joints_at(((row + 0.5) / 120 - 0.5) * 0.08))
    assert np.abs(rolling[row] - seen[row]).max() < 0.06
    assert rolling.min() > 0.01


def test_a_rolling_shutter_of_zero_is_the_global_one(renderer):
    (rolling, joints_at), (shared, _) = renderer(exposure=0.03, readout=0.0), renderer(exposure=0.03)
    np.testing.assert_array_equal(rolling.expose(joints_at), shared.expose(joints_at))
    (tiny, _) = renderer(exposure=0.03, readout=1e-9)
    np.testing.assert_allclose(tiny.expose(joints_at), shared.expose(joints_at), atol=1e-6)


def test_a_camera_that_stands_still_shows_neither_blur_nor_rolling_shutter(renderer):
    camera, joints_at = renderer(exposure=0.05, readout=0.08)
    np.testing.assert_array_equal(camera.expose(lambda time: joints_at(0.0)), camera.render(joints_at(0.0)))


@pytest.mark.parametrize("rows", [(0, 1), (7, 30), (64, 65), (100, 120)])
def test_some_rows_are_rendered_as_in_the_whole_picture(renderer, rows):
    camera, joints_at = renderer()
    q, light = joints_at(0.0), camera.world.scene.lights[0]
    np.testing.assert_array_equal(camera._sharp(q, light, slice(*rows), 1), camera.render(q)[slice(*rows)])


@pytest.mark.parametrize(("exposure", "readout"), [(0.01, 0.02), (0.05, 0.0), (0.0, 0.07), (1e-12, 0.07)])
@pytest.mark.parametrize("steps", [1, 2, 9])
def test_weights_of_instants_add_to_one_and_have_the_rows_own_time_as_their_mean(exposure, readout, steps):
    sensor = Sensor(exposure=exposure, readout=readout, rate=10, latency=0.1)
    times, weights = exposure_times(sensor, 50, steps)
    assert (weights >= 0.0).all()
    np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-9)
    own = ((np.arange(50) + 0.5) / 50 - 0.5) * readout
    np.testing.assert_allclose(times @ weights, own, atol=1e-9)


def test_more_motion_is_mixed_of_more_pictures_and_at_most_half_a_pixel_apart(renderer, monkeypatch):
    camera, joints_at = renderer(exposure=0.05)
    asked = []
    monkeypatch.setattr(camera, "_sharp", lambda q, *rest: asked.append(q) or np.zeros((120, 160)))
    counts = []
    for share in (0.005, 0.5, 1.0, 2.0):
        asked.clear()
        camera.expose(lambda time, share=share: joints_at(share * time))
        counts.append(len(asked))
    moved = camera._motion(joints_at(-0.025), joints_at(0.025))
    assert counts[0] == 1
    assert counts[2] == np.ceil(moved / 0.5) + 1
    assert counts[1] < counts[2] < counts[3]


def test_a_robot_exposes_along_its_own_motion_round_the_time_stamp(make_scene):
    sensor = Sensor(exposure=0.03, readout=0.04, **CLEAN)
    robot = SimulatedRobot(make_scene(camera=SMALL, sensor=sensor))
    robot.command(SPEED)
    joints = {}
    for _ in range(301):
        joints[round(robot.time, 3)] = robot.read().joint_positions
        robot.advance(0.001)
    stamp = robot.image().time
    assert stamp == pytest.approx(0.2)
    renderer = UnifiedRenderer(robot.world)
    times = sorted(joints)
    track = np.array([joints[t] for t in times])

    def joints_at(time):
        return np.array([np.interp(stamp + time, times, angle) for angle in track.T])

    expected = renderer.photograph(joints_at, np.random.default_rng(0)).astype(int)
    assert np.abs(robot.image().pixels - expected).max() <= 1
    still = renderer.photograph(joints_at(0.0), np.random.default_rng(0)).astype(int)
    assert np.abs(robot.image().pixels - still).max() > 20


def test_before_the_start_the_arm_stood_still(make_scene):
    sensor = Sensor(exposure=0.03, readout=0.04, **CLEAN)
    robot = SimulatedRobot(make_scene(camera=SMALL, sensor=sensor))
    robot.advance(0.1)
    still = UnifiedRenderer(robot.world).photograph(robot.world.scene.start_joints, np.random.default_rng(0))
    assert robot.image().time == 0.0
    np.testing.assert_array_equal(robot.image().pixels, still)
