"""One small scene: an RX60 that looks at a wall with dots."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.robots import Arm
from omniservo.scenes import Dots, Scene, SceneBox, Sensor

START = np.deg2rad([-0.7, 43.2, -64.6, 0.8, 111.4, 0.3])
WALL_FACE = 0.62  # [m] the wall's face, world x
DOT_RADIUS = 0.008  # [m]


def wall(name="wall"):
    return SceneBox(name, RigidTransform.from_translation([WALL_FACE + 0.01, 0, 0.5]), [0.01, 1.5, 1.0])


def dots_on_the_wall(radius=DOT_RADIUS):
    y, z = np.meshgrid(np.linspace(-0.35, 0.25, 7), np.linspace(0.3, 0.7, 5))
    centers = np.stack([np.full(y.size, WALL_FACE - 1e-4), y.ravel(), z.ravel()], axis=-1)
    return Dots(centers, np.tile([-1.0, 0, 0], (y.size, 1)), radius)


@pytest.fixture(scope="session")
def fisheye():
    # the 2012 paper's camera, section 4; its lens sees 185 degrees
    return UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.2910, 659, 432, max_angle=np.deg2rad(92.5))


@pytest.fixture(scope="session")
def arm():
    return Arm.rx60()


@pytest.fixture(scope="session")
def make_scene(arm, fisheye):
    def make(**changes):
        values = {
            "arm": arm,
            "world_T_base": RigidTransform.from_translation([0, 0, -0.341]),
            "flange_T_camera": RigidTransform.from_components(
                [0, 0, 0.0905], Rotation.from_euler("z", 90, degrees=True)
            ),
            "camera": fisheye,
            "start_joints": START,
            "sensor": Sensor(rate=30, latency=0.02, noise=2.0, blur=0.4),
            "dots": dots_on_the_wall(),
            "boards": (wall(),),
            "floor": -0.341,
        }
        return Scene(**(values | changes))

    return make
