"""Small patches of an image as planes tangent to the sphere of view show them, whatever the lens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.perception.patch_kernels import FloatImage, write_greys, write_rays

_STEP = 1e-4
"""of the central differences, on the tangent plane"""


@dataclass(frozen=True, eq=False)
class TangentFrames:
    """A plane tangent to the unit sphere at each bearing: place (x, y) is direction b + x·e + y·f."""

    bearings: FloatArray
    """(n, 3) b, unit"""
    first: FloatArray
    """(n, 3) e, unit, at right angles to b"""

    @classmethod
    def at(cls, bearings: FloatArray) -> TangentFrames:
        """Frames at bearings (n, 3), e along the camera's x axis where that lies in no one's way."""
        along = np.where(np.abs(bearings[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        first = along - (along * bearings).sum(1, keepdims=True) * bearings
        return cls(bearings, first / np.linalg.norm(first, axis=1, keepdims=True))

    def __len__(self) -> int:
        return len(self.bearings)

    def __getitem__(self, rows: BoolArray | IntArray) -> TangentFrames:
        return TangentFrames(self.bearings[rows], self.first[rows])

    @property
    def second(self) -> FloatArray:
        """(n, 3) f = b × e."""
        return np.cross(self.bearings, self.first)

    def directions(self, places: FloatArray) -> FloatArray:
        """Directions (n, …, 3) of places (n, …, 2) on the planes; not unit."""
        shape = (len(self), *(1,) * (places.ndim - 2), 3)
        b, e, f = (a.reshape(shape) for a in (self.bearings, self.first, self.second))
        return np.asarray(b + places[..., :1] * e + places[..., 1:] * f)

    def places(self, bearings: FloatArray) -> FloatArray:
        """Places (n, 2) on the planes of bearings (n, 3), one a plane; NaN 90° and more from its point."""
        depth = (bearings * self.bearings).sum(1)
        along = np.stack([(bearings * a).sum(1) for a in (self.first, self.second)], axis=1)
        return np.asarray(along / np.where(depth > 0.0, depth, np.nan)[:, None])

    def jacobians(self, camera: CentralModel) -> FloatArray:
        """∂pixel/∂place (n, 2, 2) [px] at the planes' points; NaN at the border of the camera's domain."""
        ends = _STEP * np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
        pixels = camera.project(self.directions(np.broadcast_to(ends, (len(self), 4, 2))))[0]
        return np.stack([pixels[:, 0] - pixels[:, 1], pixels[:, 2] - pixels[:, 3]], axis=2) / (2.0 * _STEP)


def grid(half: int) -> FloatArray:
    """Places ((2·half + 1)², 2) of a square of samples, row by row, one apart, its middle at 0."""
    steps = np.arange(-half, half + 1, dtype=np.float64)
    y, x = np.meshgrid(steps, steps, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1)


def sample(
    camera: CentralModel,
    image: FloatImage,
    frames: TangentFrames,
    places: FloatArray,
    maps: FloatArray,
    samples: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Grey values (n, k) at p + M·u on the planes, cubic, and their pixels (n, k, 2) [px].

    Outside the image the grey is that of its border; where the camera sees nothing, pixels are NaN and the
    grey means nothing.

    Args:
        camera: took the image.
        image: float32 grey values.
        frames: (n) the planes.
        places: (n, 2) p.
        maps: (n, 2, 2) M.
        samples: (k, 2) u.
    """
    rays = np.empty((len(frames), len(samples), 3))
    write_rays(frames.bearings, frames.first, places, maps, samples, rays)
    pixels = camera.project(rays)[0]
    greys = np.empty(pixels.shape[:2])
    write_greys(image, pixels, greys)
    return greys, pixels
