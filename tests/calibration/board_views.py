"""Corners of a board as a known camera sees them: what the calibration tests and benchmark draw."""

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera


def board(columns: int = 9, rows: int = 6, square: float = 0.03) -> np.ndarray:
    """Return the inner corners (columns·rows, 3) [m] of a checkerboard, x fastest, z = 0."""
    x, y = np.meshgrid(np.arange(columns) * square, np.arange(rows) * square)
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], 1)


def draw_views(
    camera: UnifiedCamera,
    rng: np.random.Generator,
    *,
    views: int = 20,
    noise_px: float = 0.3,
    largest_angle: float = np.radians(92.0),
    distances: tuple[float, float] = (0.12, 0.35),
    tilt: float = np.radians(45.0),
    target: np.ndarray | None = None,
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return corners [px] and target points [m] of ``views`` random poses whose corners are all in the image.

    The target's centre lies in a direction uniform over the field up to ``largest_angle``, at a uniform
    distance; the
    target faces the camera, is turned about the line of sight by any angle and tilted by up to ``tilt``.
    """
    points = board() if target is None else target
    local = points - points.mean(0)
    seen: list[np.ndarray] = []
    while len(seen) < views:
        cosine = rng.uniform(np.cos(largest_angle), 1.0)
        azimuth = rng.uniform(-np.pi, np.pi)
        sine = np.sqrt(1.0 - cosine**2)
        ray = np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])
        facing, _ = Rotation.align_vectors(ray[None], [[0.0, 0.0, 1.0]])
        lean = rng.uniform(0.0, tilt) * np.array(
            [np.cos(turn := rng.uniform(-np.pi, np.pi)), np.sin(turn), 0.0]
        )
        pose = (
            facing * Rotation.from_rotvec(lean) * Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        )
        corners, valid = camera.project(pose.apply(local) + rng.uniform(*distances) * ray)
        noisy = corners + rng.normal(scale=noise_px, size=corners.shape)
        if valid.all() and camera.in_image(noisy).all():
            seen.append(noisy)
    return seen, [points] * views
