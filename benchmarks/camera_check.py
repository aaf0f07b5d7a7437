"""Is a bumped camera noticed, and one that stands still left in peace?

Run: ``python -m benchmarks.camera_check [PAIRS]``. Pairs of rendered images of a room with boards standing
about, through a fisheye of 190° and a perspective lens; of every pair the boards are others, elsewhere, which
changes a third of the image and more, and the light is another: its own gain from place to place by a factor
of 2, gamma and noise. In half of the pairs the camera stands still, in the others it was bumped: turned about
any axis, and displaced.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np
from benchmarks.pictured_scenes import LENS, OTHER_LENS, Face, picture_of
from benchmarks.tables import print_table
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from omniservo.calibration import CameraCheck, check_camera
from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.scenes.textures import texture, texture_kinds

LENSES = {"fisheye of 190°": (LENS, 5), "perspective": (OTHER_LENS, 2)}
"""and how many boards stand about in what it sees"""
BUMPS = (1.0, 3.0, 10.0, 37.0)
"""[px] of the image, root mean square"""
WALLS = (
    ((0.0, 0.0, 1.2), (0.0, 0.0, 0.0), 1.4),
    ((-0.9, 0.0, 0.6), (0.0, 1.4, 0.0), 1.0),
    ((0.9, 0.0, 0.6), (0.0, -1.4, 0.0), 1.0),
    ((0.0, 0.6, 0.7), (1.4, 0.0, 0.0), 1.2),
)
"""centre [m], rotation vector, half side [m]"""


@dataclass(frozen=True)
class Pair:
    """What was found in two images, and what was there to be found."""

    found: CameraCheck
    was_T_now: RigidTransform
    bumped: bool


def face(rng: np.random.Generator, centre: FloatArray, turn: FloatArray, half: float) -> Face:
    """Return a rectangle with a texture of about 2 mm a texel."""
    kind, size = texture_kinds()[int(rng.integers(len(texture_kinds())))], int(1000.0 * half)
    pose = RigidTransform.from_components(centre, Rotation.from_rotvec(turn))
    return Face(pose, np.array([half, half]), texture(kind, int(rng.integers(10**6)), size, size))


def boards(rng: np.random.Generator, count: int) -> list[Face]:
    """Return what stands about in the room."""
    return [
        face(
            rng,
            rng.uniform([-0.6, -0.4, 0.6], [0.6, 0.4, 1.0]),
            rng.uniform(-0.4, 0.4, 3),
            rng.uniform(0.12, 0.25),
        )
        for _ in range(count)
    ]


def other_light(image: ByteArray, rng: np.random.Generator) -> ByteArray:
    """Return an image as another light shows it: gain from place to place, gamma, noise."""
    smooth = gaussian_filter(rng.normal(size=image.shape), image.shape[1] / 6)
    gain = rng.uniform(0.7, 1.3) * np.exp(0.35 * smooth / smooth.std())
    bright = 255.0 * np.clip(image / 255.0 * gain, 0.0, 1.0) ** rng.uniform(0.8, 1.25)
    return np.asarray(np.clip(np.rint(bright + rng.normal(size=image.shape)), 0, 255).astype(np.uint8))


def bump(camera: UnifiedCamera, size: float, rng: np.random.Generator) -> RigidTransform:
    """Return was_T_now that moves the image of a sphere of 1 m by ``size`` px, a tenth by displacement."""
    axis, direction = rng.normal(size=(2, 3))
    u, v = np.meshgrid(np.linspace(0, camera.width - 1, 12), np.linspace(0, camera.height - 1, 9))
    pixels = np.stack((u.ravel(), v.ravel()), axis=1)
    bearings, valid = camera.unproject(pixels)
    bearings, pixels = bearings[valid], pixels[valid]

    def moved(turn: float) -> RigidTransform:
        shift = 0.1 * turn * direction / np.linalg.norm(direction)
        return RigidTransform.from_components(shift, Rotation.from_rotvec(turn * axis / np.linalg.norm(axis)))

    ahead, seen = camera.project(moved(1e-4).inv().apply(bearings))
    rms = math.sqrt(float(((ahead - pixels)[seen] ** 2).sum(1).mean()))
    return moved(1e-4 * size / rms)


def pair(camera: UnifiedCamera, count: int, size: float, seed: int) -> Pair:
    """Return what is found in two images, ``count`` boards in each, a bump of ``size`` px between them."""
    rng = np.random.default_rng([20261124, seed])
    walls = [face(rng, np.array(centre), np.array(turn), half) for centre, turn, half in WALLS]
    pose = RigidTransform.identity() if size == 0.0 else bump(camera, size, rng)
    was = picture_of(walls + boards(rng, count), camera, RigidTransform.identity(), rng)
    now = other_light(picture_of(walls + boards(rng, count), camera, pose, rng), rng)
    return Pair(check_camera(camera, was, now), pose, size > 0.0)


def row(name: str, size: float, pairs: list[Pair]) -> str:
    """Return a row of the table: what was said, and whether the 95% ellipsoid holds the rotation."""
    said = [p.found.moved for p in pairs]
    known = [p for p in pairs if p.found.moved is not None]
    errors = [
        (Rotation.from_rotvec(p.found.rotation).inv() * p.was_T_now.rotation).as_rotvec() for p in known
    ]
    inside = [
        float(e @ np.linalg.solve(p.found.covariance[:3, :3], e)) < chi2.ppf(0.95, 3)
        for e, p in zip(errors, known, strict=True)
    ]
    turn = np.degrees(np.median([np.linalg.norm(e) for e in errors])) if errors else math.nan
    counts = f"{said.count(True)} | {said.count(False)} | {said.count(None)}"
    held = 100.0 * np.mean(inside) if inside else math.nan
    return f"{name} | {size:g} | {len(pairs)} | {counts} | {turn:.3f} | {held:.0f}"


def main() -> None:
    """Print the table; as many pairs stand still as are bumped."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 25
    rows = []
    for name, (camera, some) in LENSES.items():
        for size, times in ((0.0, len(BUMPS) * count), *((size, count) for size in BUMPS)):
            rows.append(
                row(name, size, [pair(camera, some, size, 1000 * int(size) + k) for k in range(times)])
            )
    header = "lens | bump [px] | pairs | moved | not moved | cannot tell | rotation off, median [°]"
    print_table(f"| {header} | rotation in the 95% ellipsoid [%] |", rows)


if __name__ == "__main__":
    main()
