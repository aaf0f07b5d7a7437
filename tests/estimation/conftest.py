"""Scenes with a known answer."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera

FISHEYE = UnifiedCamera(296.9365, 298.4197, 316.8076, 254.9012, 1.2910, 659, 432)
PERSPECTIVE = UnifiedCamera(400.0, 405.0, 320.0, 240.0, 0.0, 640, 480)
CATADIOPTRIC = UnifiedCamera(260.0, -262.0, 320.0, 240.0, 1.0, 640, 480)
DISTORTED = UnifiedCamera(
    700.0, 702.0, 640.0, 512.0, 0.9, 1280, 1024, distortion=(-0.2, 0.03, 1e-3, -5e-4), skew=0.4
)


@dataclass
class Scene:
    camera: UnifiedCamera
    points: np.ndarray
    initial_T_goal: RigidTransform
    pixels_initial: np.ndarray
    pixels_goal: np.ndarray

    @cached_property
    def rotation(self) -> Rotation:
        return self.initial_T_goal.rotation

    @property
    def translation(self) -> np.ndarray:
        return self.initial_T_goal.translation

    def noisy(self, rng, sigma):
        """Both images with Gaussian noise [px]."""
        return (
            self.pixels_initial + sigma * rng.normal(size=self.pixels_initial.shape),
            self.pixels_goal + sigma * rng.normal(size=self.pixels_goal.shape),
        )


def look(camera, points, rotation, translation) -> Scene:
    pose = RigidTransform.from_components(translation, rotation)
    initial, seen = camera.project(points)
    goal, seen_again = camera.project(pose.inv().apply(points))
    assert seen.all()
    assert seen_again.all()
    return Scene(camera, points, pose, initial, goal)


def paper_scene(example: int) -> Scene:
    """The paper's two displacements before its two boards (ridge, ±4 mm)."""
    if example == 1:
        centre, step, fall = (0.0, -0.08, 0.40), (0.08, 0.06), 0.07
        translation, turn = (0.0497e-3, -99.9782e-3, 199.9552e-3), (-0.0030, 0.0013, -0.0015)
    else:
        centre, step, fall = (-0.12, 0.02, 0.36), (0.07, 0.05), 0.04
        translation, turn = (-202.0935e-3, 0.0154e-3, -8.2329e-3), (-0.0111, -24.9738, 0.0056)
    points = np.array(
        [
            (
                centre[0] + i * step[0],
                centre[1] + k * step[1],
                centre[2] - abs(i) * fall + (0.004 if (i + k) % 2 else -0.004),
            )
            for k in (-1, 0, 1)
            for i in (-1, 0, 1)
        ]
    )
    return look(FISHEYE, points, Rotation.from_rotvec(np.deg2rad(turn)), np.array(translation))


def random_scene(rng, n=9, camera=FISHEYE, spread=0.12, distance=0.5, baseline=0.2, turn=0.3) -> Scene:
    points = np.array([0.0, 0.0, distance]) + spread * rng.uniform(-1, 1, (n, 3))
    direction = rng.normal(size=3)
    translation = baseline * direction / np.linalg.norm(direction)
    return look(camera, points, Rotation.from_rotvec(turn * rng.uniform(-1, 1, 3)), translation)


@pytest.fixture
def make_scene() -> Callable[..., Scene]:
    return random_scene


@pytest.fixture
def make_paper_scene() -> Callable[[int], Scene]:
    return paper_scene


@pytest.fixture
def make_view() -> Callable[..., Scene]:
    return look


@pytest.fixture(params=["fisheye", "perspective", "catadioptric", "distorted"])
def camera(request) -> UnifiedCamera:
    cameras = {
        "fisheye": FISHEYE,
        "perspective": PERSPECTIVE,
        "catadioptric": CATADIOPTRIC,
        "distorted": DISTORTED,
    }
    return cameras[request.param]


@pytest.fixture
def fisheye() -> UnifiedCamera:
    return FISHEYE
