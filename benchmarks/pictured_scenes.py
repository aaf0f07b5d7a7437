"""Small pictures of textured faces through any unified camera, for benchmarks that need thousands of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.scenes.textures import texture, texture_kinds

LENS = UnifiedCamera(150.0, 150.0, 159.5, 119.5, 1.0, 320, 240, max_angle=np.radians(95.0))
"""A fisheye of 190°, small for speed."""

WIDE = UnifiedCamera(90.0, 90.0, 159.5, 119.5, 1.291, 320, 240)
"""A fisheye that sees to 140° from its axis."""

OTHER_LENS = UnifiedCamera(290.0, 290.0, 159.5, 119.5, 0.0, 320, 240)
"""What the same picture would be with a perspective lens."""


@dataclass(frozen=True, eq=False)
class Face:
    """A textured rectangle."""

    initial_T_face: RigidTransform
    """centre, x right and y down in the picture"""
    half: FloatArray
    """(2,) [m]"""
    picture: FloatArray
    """(rows, columns) greys 0 to 1"""


def crate(rng: np.random.Generator, picture: FloatArray | None = None) -> list[Face]:
    """Return a floor, a back and a front face at random, about half a metre ahead."""
    faces = []
    for depth, half in ((rng.uniform(0.7, 0.9), 0.9), (rng.uniform(0.40, 0.5), 0.13), (0.58, 0.16)):
        kind = texture_kinds()[int(rng.integers(len(texture_kinds())))]
        shown = texture(kind, int(rng.integers(10**6)), 512, 512) if picture is None else picture
        aside = [0.0, 0.0] if half > 0.5 else rng.uniform(-0.22, 0.22, 2)
        tilt = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3) * (0.2 if half > 0.5 else 1.0))
        pose = RigidTransform.from_components([*aside, depth], tilt)
        faces.append(Face(pose, np.array([half, half]), shown))
    return faces


def stripes(rng: np.random.Generator) -> FloatArray:
    """Return a pattern that repeats exactly, in both directions."""
    tile = texture("poster", int(rng.integers(10**6)), 64, 64)
    return np.tile(tile, (8, 8))


def motion(rng: np.random.Generator, length: float = 0.15, turn: float = 0.25) -> RigidTransform:
    """Return initial_T_goal: a displacement of about ``length`` [m] and a turn of about ``turn`` [rad]."""
    direction = rng.normal(size=3)
    axis = rng.normal(size=3)
    return RigidTransform.from_components(
        rng.uniform(0.5, 1.0) * length * direction / np.linalg.norm(direction),
        Rotation.from_rotvec(turn * rng.uniform(0.2, 1.0) * axis / np.linalg.norm(axis)),
    )


def picture_of(
    faces: list[Face],
    camera: UnifiedCamera,
    initial_T_camera: RigidTransform,
    rng: np.random.Generator,
    *,
    noise: float = 2.0,
    rays: int = 2,
) -> ByteArray:
    """Return the grey values (height, width): every pixel the mean of its rays, lens blur, sensor noise.

    ``rays`` are those per side of a pixel; straight edges, as of tags, need four.
    """
    offsets = (np.arange(rays) + 0.5) / rays - 0.5
    u, v = np.meshgrid(
        (np.arange(camera.width)[:, None] + offsets).ravel(),
        (np.arange(camera.height)[:, None] + offsets).ravel(),
    )
    bearings, valid = camera.unproject(np.stack((u, v), axis=-1))
    ways = np.where(valid[..., None], bearings, 1.0).reshape(-1, 3)
    directions = ways @ initial_T_camera.rotation.as_matrix().T
    grey = np.full(len(directions), 0.25)
    nearest = np.full(len(directions), np.inf)
    middle = bearings[len(bearings) // 2, bearings.shape[1] // 2 :][:2]
    step = float(np.linalg.norm(middle[1] - middle[0]))
    for face in faces:
        _paint(_averaged(face, initial_T_camera, step), initial_T_camera, directions, grey, nearest)
    grey = np.where(valid, grey.reshape(valid.shape), 0.02)
    image = grey.reshape(camera.height, rays, camera.width, rays).mean(axis=(1, 3))
    seen = gaussian_filter(255.0 * image, 0.5) + noise * rng.standard_normal(image.shape)
    return np.asarray(np.clip(np.rint(seen), 0, 255).astype(np.uint8))


def _averaged(face: Face, initial_T_camera: RigidTransform, step: float) -> Face:
    """Return ``face`` with its picture averaged over the distance between rays that are ``step`` [rad] apart.

    What is finer than rays would be met or missed as chance has it, alike over whole regions, as no camera
    does: a pixel is the mean over its square. The Gaussian has the standard deviation of a box that wide.
    """
    apart = np.linalg.norm(face.initial_T_face.translation - initial_T_camera.translation)
    element = 2.0 * face.half[::-1] / face.picture.shape
    return replace(face, picture=gaussian_filter(face.picture, step * apart / element / np.sqrt(12.0)))


def _paint(
    face: Face, initial_T_camera: RigidTransform, rays: FloatArray, grey: FloatArray, nearest: FloatArray
) -> None:
    """Write what of ``face`` the rays meet first, in place."""
    turned = face.initial_T_face.rotation.inv()
    towards = face.initial_T_face.translation - initial_T_camera.translation
    origin = turned.apply(-towards)
    # rays that pass the ball around the face miss it, for a camera outside of the ball
    beside = towards @ towards - face.half @ face.half
    near = np.flatnonzero(rays @ towards > (np.sqrt(beside) - 1e-9 if beside > 0.0 else -np.inf))
    right, down, ahead = turned.as_matrix() @ rays[near].T
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = -origin[2] / ahead
    hit = np.flatnonzero((distance > 0.0) & (distance < nearest[near]))
    x, y = (origin[i] + distance[hit] * way[hit] for i, way in enumerate((right, down)))
    on = (np.abs(x) < face.half[0]) & (np.abs(y) < face.half[1])
    first, hit, x, y = distance[hit[on]], near[hit[on]], x[on], y[on]
    rows, columns = face.picture.shape
    column = (x / face.half[0] + 1.0) * 0.5 * columns - 0.5
    row = (y / face.half[1] + 1.0) * 0.5 * rows - 0.5
    grey[hit] = map_coordinates(face.picture, (row, column), order=1, mode="nearest")
    nearest[hit] = first


def smeared(image: ByteArray, length: int, rng: np.random.Generator) -> ByteArray:
    """Return an image blurred along a random direction by ``length`` [px]."""
    kernel = np.zeros((length, length), np.float32)
    angle = rng.uniform(0, np.pi)
    reach = 0.5 * (length - 1)
    for s in np.linspace(-reach, reach, 4 * length):
        kernel[round(reach + s * np.sin(angle)), round(reach + s * np.cos(angle))] += 1.0
    return np.asarray(cv2.filter2D(image, -1, kernel / kernel.sum()))
