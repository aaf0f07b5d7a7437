"""Pictures of planar patches with exactly known dot centres: the independent reference of this room.

A pixel's grey is the mean over 8×8 rays `camera.unproject` of its square, in linear intensity; then optical
blur, noise and quantisation. Nothing of the perception room is used here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera

Array = npt.NDArray[np.float64]
SUBSAMPLES = 8


def paper_camera(**changes: object) -> UnifiedCamera:
    """The paper's fisheye (K and ξ of section 4, 185°)."""
    values = {"fx": 296.9365, "fy": 298.4197, "cx": 316.8076, "cy": 254.9012, "xi": 1.291}
    values |= {"width": 659, "height": 432, "max_angle": np.deg2rad(92.5)}
    return UnifiedCamera(**(values | changes))


@dataclass(frozen=True)
class Patch:
    """A flat rectangle or ellipse: columns of ``axes`` are its x, y and normal in the camera frame."""

    centre: Array
    axes: Array
    half: tuple[float, float]
    grey: float
    is_round: bool = False

    def outline(self, count: int = 64) -> Array:
        """Points (count, 3) [m] that enclose the patch."""
        angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
        reach = 1.0 if self.is_round else np.sqrt(2)
        x, y = reach * self.half[0] * np.cos(angle), reach * self.half[1] * np.sin(angle)
        return self.centre + np.stack([x, y], 1) @ self.axes[:, :2].T

    def cone(self) -> tuple[Array, float]:
        """Axis and cosine of half the angle of a cone from the origin that holds the patch."""
        rays = self.outline() / np.linalg.norm(self.outline(), axis=1, keepdims=True)
        axis = self.centre / np.linalg.norm(self.centre)
        return axis, float(np.cos(min(1.05 * np.arccos((rays @ axis).min()) + 0.01, np.pi)))

    def hits(self, bearings: Array) -> Array:
        """Distance (n,) [m] along each ray, infinity where it misses."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (self.centre @ self.axes[:, 2]) / (bearings @ self.axes[:, 2])
            p = (bearings * distance[:, None] - self.centre) @ self.axes[:, :2] / self.half
            inside = (p**2).sum(1) <= 1 if self.is_round else (np.abs(p) <= 1).all(1)
            return np.where(inside & (distance > 0), distance, np.inf)


@dataclass(frozen=True)
class Scene:
    """Patches in the camera frame, in front of a background of one grey."""

    patches: list[Patch]
    background: float = 90.0
    dots: Array = field(default_factory=lambda: np.zeros((0, 3)))


def plane_axes(normal: Array, spin: float = 0.0) -> Array:
    """A right-handed frame whose third column is ``normal``, turned about it by ``spin`` [rad]."""
    z = normal / np.linalg.norm(normal)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(z, x), z], 1)
    return frame @ Rotation.from_rotvec([0, 0, spin]).as_matrix()


def dot_patches(centres: Array, normals: Array, radius: float, *, board: float = 3.0) -> list[Patch]:
    """Each dot on its own square plate of half side ``board`` radii."""
    patches = []
    for centre, normal in zip(centres, normals, strict=True):
        axes = plane_axes(normal)
        toward = -np.sign(normal @ centre) * 1e-6 * axes[:, 2]
        patches.append(Patch(centre, axes, (board * radius, board * radius), 215.0))
        patches.append(Patch(centre + toward, axes, (radius, radius), 15.0, is_round=True))
    return patches


def render(
    camera: UnifiedCamera,
    scene: Scene,
    *,
    noise: float = 2.0,
    blur: float = 0.0,
    rng: np.random.Generator | None = None,
) -> npt.NDArray[np.uint8]:
    """Render ``scene``: (height, width) grey values of 0…255."""
    return expose(intensity(camera, scene), noise=noise, blur=blur, rng=rng)


def expose(
    exact: Array, *, noise: float = 2.0, blur: float = 0.0, rng: np.random.Generator | None = None
) -> npt.NDArray[np.uint8]:
    """Blur, noise and quantisation of a linear picture."""
    picture = gaussian_filter(exact, blur) if blur else exact
    if noise:
        picture = picture + (rng or np.random.default_rng(0)).normal(0, noise, exact.shape)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def intensity(camera: UnifiedCamera, scene: Scene) -> Array:
    """The picture before blur and noise: (height, width), real-valued."""
    h, w = camera.height, camera.width
    grid, bearings, valid = _grid(camera)
    greys = _shade(scene, bearings, valid)
    picture = greys.reshape(h, w)
    edge = (maximum_filter(picture, 3) != minimum_filter(picture, 3)).reshape(-1)
    step = (np.arange(SUBSAMPLES) + 0.5) / SUBSAMPLES - 0.5
    offsets = np.stack(np.meshgrid(step, step), -1).reshape(-1, 2)
    fine = (grid[edge][:, None] + offsets).reshape(-1, 2)
    greys[edge] = _shade(scene, *camera.unproject(fine)).reshape(-1, SUBSAMPLES**2).mean(1)
    return greys.reshape(h, w)


@lru_cache(maxsize=4)
def _grid(camera: UnifiedCamera) -> tuple[Array, Array, npt.NDArray[np.bool_]]:
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    grid = np.stack([u, v], -1).reshape(-1, 2)
    return grid, *camera.unproject(grid)


def _shade(scene: Scene, bearings: Array, valid: npt.NDArray[np.bool_]) -> Array:
    greys = np.where(valid, scene.background, 0.0)
    nearest = np.full(len(bearings), np.inf)
    x, y, z = np.ascontiguousarray(bearings.T)
    for patch in scene.patches:
        axis, cosine = patch.cone()
        along = axis[0] * x + axis[1] * y + axis[2] * z
        index = np.flatnonzero(valid & (along >= cosine))
        distance = patch.hits(bearings[index])
        closer = distance < nearest[index]
        nearest[index[closer]] = distance[closer]
        greys[index[closer]] = patch.grey
    return greys


def image_area(camera: UnifiedCamera, patch: Patch) -> float:
    """Area [px²] of the image of a round patch, from its outline."""
    u, v = camera.project(patch.outline(400))[0].T
    return float(0.5 * abs(u @ np.roll(v, -1) - v @ np.roll(u, -1)))
