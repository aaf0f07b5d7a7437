"""The cameras that the conformance tests run over."""

from pathlib import Path

import numpy as np
import pytest

from omniservo.camera_files import load_camera
from omniservo.cameras import PRESETS, DeadZone, UnifiedCamera

SYNTHETIC = {
    "skew": UnifiedCamera(410.0, 395.0, 322.0, 236.0, 0.8, 640, 480, skew=3.5),
    "mirrored": UnifiedCamera(-300.0, 305.0, 318.0, 243.0, 1.0, 640, 480, skew=-1.0),
    "xi 0.5": UnifiedCamera(390.0, 390.0, 319.5, 239.5, 0.5, 640, 480, max_angle=1.9),
    "xi 1.291": UnifiedCamera(296.9, 298.4, 316.8, 254.9, 1.291, 659, 432),
    "xi 2.2": UnifiedCamera(800.0, 790.0, 640.0, 400.0, 2.2, 1280, 800, max_angle=np.radians(95.0)),
    "barrel": UnifiedCamera(420.0, 420.0, 320.0, 240.0, 0.0, 640, 480, distortion=(-0.28, 0.07, 1e-3, -5e-4)),
    "folding": UnifiedCamera(300.0, 300.0, 320.0, 240.0, 0.6, 640, 480, distortion=(-0.35, 0.02, 2e-3, 1e-3)),
    "tangential": UnifiedCamera(
        100.0, 105.0, 320.0, 240.0, 0.1, 640, 480, distortion=(1e-3, 2e-3, 3e-3, 4e-3)
    ),
    "mirrored, distorted": UnifiedCamera(
        330.0,
        -330.0,
        640.0,
        520.0,
        1.0,
        1280,
        1024,
        distortion=(-0.05, 0.01, 1e-3, 1e-3),
        max_angle=1.75,
        dead_zone=DeadZone((645.0, 512.0), 58.0),
        skew=2.0,
    ),
}

REAL = {
    "KITTI-360 image_02": ("mei_yaml/KITTI-360__image_02.yaml", None),
    "KITTI-360 image_03": ("mei_yaml/KITTI-360__image_03.yaml", None),
    "mynteye": ("mei_yaml/VINS-Fusion__mynteye_left_mei.yaml", None),
    "VINS simulation": ("mei_yaml/VINS-Fusion__simulation_cam0_mei.yaml", None),
    "D2SLAM quad cam2": ("kalibr/HKUST-Aerial-Robotics_D2SLAM__quad_cam_calib-camchain-imucam.yaml", "cam2"),
    "Kalibr wiki cam0": ("kalibr/kalibr-wiki__yaml-formats_omni_stereo.yaml", "cam0"),
}


def _camera(name: str, request: pytest.FixtureRequest) -> UnifiedCamera:
    if name in PRESETS:
        return PRESETS[name]
    if name in SYNTHETIC:
        return SYNTHETIC[name]
    folder: Path = request.getfixturevalue("shared_data")
    path, which = REAL[name]
    return load_camera(folder / "calibrations" / path, name=which)


@pytest.fixture(params=[*PRESETS, *SYNTHETIC, *REAL])
def camera(request: pytest.FixtureRequest) -> UnifiedCamera:
    """Every camera of the suite in turn."""
    return _camera(request.param, request)


@pytest.fixture(params=["barrel", "folding", "tangential", "mirrored, distorted", *REAL])
def distorted_camera(request: pytest.FixtureRequest) -> UnifiedCamera:
    """Every camera with distortion in turn."""
    return _camera(request.param, request)


@pytest.fixture(params=[*PRESETS, "skew", "mirrored", "xi 0.5", "xi 1.291", "xi 2.2"])
def plain_camera(request: pytest.FixtureRequest) -> UnifiedCamera:
    """Every camera without distortion in turn."""
    return _camera(request.param, request)


@pytest.fixture
def rays() -> np.ndarray:
    """Directions all round, (20000, 3), unit."""
    directions = np.random.default_rng(7).normal(size=(20_000, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)
