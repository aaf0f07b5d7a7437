"""An RX60 in the simulator, what reached it written down on the way."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.robots import Arm
from omniservo.safety import SafetyOptions, Supervisor
from omniservo.scenes import Dots, Scene, Sensor
from omniservo.simulation import SimulatedRobot

START = np.deg2rad([-0.7, 43.2, -64.6, 0.8, 111.4, 0.3])


class WrittenDown:
    """An arm and camera that are passed on to, with every command and every posture kept."""

    def __init__(self, robot):
        self.robot = robot
        self.commands = [(0.0, np.zeros(6))]
        self.joints = []
        self.stops = 0
        self.closed = 0
        self.broken = {}

    def read(self):
        state = self.robot.read()
        return replace(state, **self.broken) if self.broken else state

    def advance(self, duration):
        self.robot.advance(duration)
        self.joints.append(self.robot.read().joint_positions)

    def image(self):
        return self.robot.image()

    def command(self, velocities):
        self.commands.append((self.robot.time, np.array(velocities)))
        self.robot.command(velocities)

    def stop(self):
        self.stops += 1
        self.robot.stop()

    def close(self):
        self.closed += 1


@pytest.fixture(scope="session")
def arm():
    return Arm.rx60()


@pytest.fixture(scope="session")
def scene(arm):
    y, z = np.meshgrid([-0.2, -0.1, 0.0], [0.4, 0.5, 0.6])
    centers = np.stack([np.full(9, 0.62), y.ravel(), z.ravel()], axis=-1)
    return Scene(
        arm=arm,
        world_T_base=RigidTransform.from_translation([0, 0, -0.341]),
        flange_T_camera=RigidTransform.from_components(
            [0, 0, 0.0905], Rotation.from_euler("z", 90, degrees=True)
        ),
        camera=preset("fe185"),
        start_joints=START,
        sensor=Sensor(rate=30, latency=0.02, noise=2.0, blur=0.4),
        dots=Dots(centers, np.tile([-1.0, 0, 0], (9, 1)), 0.008),
        boards=(),
        floor=None,
    )


@pytest.fixture(scope="session")
def simulated(scene):
    """Its frames come in time but empty: what would be found in them the tests say."""
    return SimulatedRobot(scene, rendered=False)


@pytest.fixture
def written(simulated):
    simulated.place(START)
    return WrittenDown(simulated)


@pytest.fixture
def guard(arm, scene, written):
    """Make a supervisor; images do not matter unless the test says so."""

    def make(arm=arm, **options):
        options = SafetyOptions(**({"image_age": 1e6} | options))
        mount, wait = scene.flange_T_camera, written.advance
        return Supervisor(written, arm, mount, camera=written, wait=wait, options=options)

    return make
