"""The simulated robot on the wall's clock: stamps, order, threads; never how fast this machine is."""

import time
from dataclasses import replace
from threading import Event

import numpy as np
import pytest

from omniservo.cameras.models import camera_from_dict
from omniservo.errors import InputError, InvalidData
from omniservo.robots import ArmDriver, ArmMode, CameraSource
from omniservo.scenes import Sensor
from omniservo.simulation import RealTimeRobot, SimulatedRobot, real_time_robot

TURN = np.array([0.1, 0.0, -0.1, 0.0, 0.1, 0.0])


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        Event().wait(2e-3)


@pytest.fixture
def scene(make_scene):
    return make_scene(sensor=Sensor(rate=30, latency=0.02, noise=2.0, blur=0.4))


@pytest.fixture
def opened(scene):
    robots = []

    def make(**options):
        sensor = options.pop("sensor", {})
        robots.append(RealTimeRobot(replace(scene, sensor=replace(scene.sensor, **sensor)), **options))
        return robots[-1]

    yield make
    for robot in robots:
        robot.close()


def test_its_joints_are_those_of_now_and_go_as_told(opened):
    robot = opened(rendered=False)
    assert isinstance(robot, ArmDriver)
    assert isinstance(robot, CameraSource)
    before = time.monotonic()
    first = robot.read()
    assert before - 2e-3 <= first.time <= time.monotonic()
    robot.command(TURN)
    until(lambda: np.allclose(robot.read().joint_velocities, TURN, atol=2e-3))
    early = robot.read()
    until(lambda: robot.read().time > early.time + 0.5)
    state = robot.read()
    assert state.time <= time.monotonic()
    turned = state.joint_positions - early.joint_positions
    np.testing.assert_allclose(turned, TURN * (state.time - early.time), rtol=0.05, atol=1e-5)
    np.testing.assert_allclose(robot.joints_at(state.time), state.joint_positions, atol=1e-4)
    robot.stop()
    until(lambda: np.abs(robot.read().joint_velocities).max() < 1e-3)


def test_a_frame_comes_no_sooner_than_its_latency_and_in_order(opened):
    robot, times = opened(rendered=False, sensor={"latency": 0.1, "rate": 50.0}), []
    end = time.monotonic() + 60.0
    while len(times) < 20 and time.monotonic() < end:
        image = robot.image()
        if image is not None and image.time not in times[-1:]:
            assert time.monotonic() - image.time >= 0.1
            times.append(image.time)
        Event().wait(1e-3)
    steps = np.diff(times) * 50.0
    assert len(times) == 20
    assert (steps > 0.9).all()
    np.testing.assert_allclose(steps, np.round(steps), atol=0.11)  # frames fall on the robot's milliseconds
    assert image.pixels.shape == (0, 0)


def test_joints_are_answered_while_a_picture_is_rendered(opened, monkeypatch):
    begun, go_on = Event(), Event()

    class Slow(real_time_robot.UnifiedRenderer):
        def photograph(self, *of):
            begun.set()
            assert go_on.wait(60.0)
            return super().photograph(*of)

    monkeypatch.setattr(real_time_robot, "UnifiedRenderer", Slow)
    robot = opened()
    assert begun.wait(60.0)
    robot.command(TURN)
    first = robot.read()
    until(lambda: robot.read().time > first.time + 0.3)
    assert np.abs(robot.read().joint_velocities).max() > 0.05
    assert robot.image() is None
    go_on.set()
    until(lambda: robot.image() is not None)


def test_its_pictures_are_those_of_the_simulator(opened, scene):
    robot, simulated = opened(), SimulatedRobot(scene)
    until(lambda: robot.image() is not None)
    simulated.advance(scene.sensor.latency + 1e-3)
    assert np.abs(robot.image().pixels.astype(float) - simulated.image().pixels).mean() < 2.0 * 2.0


def test_it_says_when_rendering_cannot_keep_up(opened, monkeypatch):
    class Slow(real_time_robot.UnifiedRenderer):
        def photograph(self, *of):
            Event().wait(0.03)
            return np.zeros((2, 2), dtype=np.uint8)

    monkeypatch.setattr(real_time_robot, "UnifiedRenderer", Slow)
    robot = opened(sensor={"rate": 100.0, "latency": 0.0})
    assert robot.behind is None
    until(lambda: robot.behind is not None)
    assert robot.behind.endswith("the camera has 100: take a lower --rate, or smaller images (--size)")


def test_smaller_images_are_no_advice_where_dots_are_drawn(opened, monkeypatch):
    class Slow:
        def __init__(self, scene):
            pass

        def drawn(self, exposure):
            Event().wait(0.03)
            return np.zeros((2, 2), dtype=np.uint8)

    monkeypatch.setattr(real_time_robot, "ProjectedDots", Slow)
    robot = opened(sensor={"rate": 100.0, "latency": 0.0}, projected=True)
    until(lambda: robot.behind is not None)
    assert robot.behind.endswith("the camera has 100: take a lower --rate")


def test_a_stopped_controller_brakes_and_obeys_nothing(opened):
    robot = opened(rendered=False)
    robot.command(TURN)
    until(lambda: np.abs(robot.read().joint_velocities).max() > 0.05)
    robot.set_mode(ArmMode.PROTECTIVE_STOP)
    robot.command(TURN)
    assert robot.read().mode is ArmMode.PROTECTIVE_STOP
    until(lambda: np.abs(robot.read().joint_velocities).max() < 1e-3)
    robot.set_mode(ArmMode.READY)
    robot.command(TURN)
    until(lambda: np.abs(robot.read().joint_velocities).max() > 0.05)


def test_closed_twice(opened):
    robot = opened(rendered=False)
    robot.close()
    robot.close()


def test_pictures_that_cannot_be_rendered_are_said_and_not_waited_for(opened, monkeypatch):
    class Broken(real_time_robot.UnifiedRenderer):
        def photograph(self, *of):
            raise MemoryError("no room")

    monkeypatch.setattr(real_time_robot, "UnifiedRenderer", Broken)
    robot = opened()
    until(lambda: robot.behind is not None)
    assert robot.behind == "no more images: MemoryError: no room"
    with pytest.raises(InvalidData, match="no more images: MemoryError"):
        robot.image()
    robot.read()


def test_a_camera_of_too_many_pixels_is_refused_before_anything_is_served(scene):
    large = {**scene.camera.to_dict(), "width": 99_999, "height": 99_999}
    with pytest.raises(InputError, match="99999x99999 pixels"):
        RealTimeRobot(replace(scene, camera=camera_from_dict(large)))


def test_frames_that_nobody_asks_for_and_their_exposures_are_forgotten(opened):
    robot = opened(rendered=False, sensor={"rate": 200.0})
    until(lambda: len(robot._numbers) > 20)
    assert len(robot._robot._exposed) < 15  # those of the latency, and of the thread's rounds
    assert len(robot._waiting) < 15
