"""Pictures of tags at known places: each pixel is the mean of many rays, then blur and noise.

A tag's pattern is OpenCV's own drawing, not ours; of an AprilTag 3 family ours (test_april_tags.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter

from omniservo.cameras import UnifiedCamera, preset
from omniservo.perception import tag_cells, tag_picture
from omniservo.tag_dictionaries import APRIL_TAGS_3, opencv_name

Array = npt.NDArray[np.float64]
RAYS = 6
DARK, BRIGHT = 25.0, 210.0

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])


def cameras() -> dict[str, UnifiedCamera]:
    """The fisheye of the paper, a distorted fisheye of 190 px/rad, and a mirror."""
    distorted = UnifiedCamera(
        551.0,
        550.2,
        254.9,
        256.9,
        1.9,
        512,
        512,
        distortion=(-0.06, 0.012, 4e-4, -3e-4),
        max_angle=np.deg2rad(97.0),
    )
    return {"fe185": preset("fe185"), "fisheye": distorted, "catadioptric": preset("hyper-catadioptric")}


@dataclass(frozen=True)
class PlacedTag:
    """A tag in the camera frame."""

    name: str
    number: int
    centre: Array
    """(3,) [m]"""
    axes: Array
    """(3, 3) columns: right and down as printed, into the paper"""
    side: float
    """of the square whose corners count [m]"""
    quiet: float = 1.0
    """white cells around it"""

    def corners(self) -> Array:
        """(4, 3) of the square [m], in the order of the code."""
        return self.centre + 0.5 * self.side * CORNERS @ self.axes[:, :2].T

    def pattern(self) -> npt.NDArray[np.bool_]:
        """(cells, cells) where it is dark."""
        if self.name in APRIL_TAGS_3:
            return tag_picture(self.name, self.number, pixels_per_cell=1) < 128
        known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(self.name)))
        return cv2.aruco.generateImageMarker(known, self.number, known.markerSize + 2) < 128

    def reach(self) -> float:
        """Half the side of the print with what is white around it, over that of the square."""
        return (len(self.pattern()) + 2.0 * self.quiet) / tag_cells(self.name)


def facing(
    name: str,
    number: int,
    direction: Array,
    distance: float,
    side: float,
    *,
    lean=(0.0, 0.0),
    spin: float = 0.0,
) -> PlacedTag:
    """A tag that looks at the camera but for ``lean`` [rad], turned by ``spin`` [rad]."""
    z = np.asarray(direction) / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    frame = np.stack([x, np.cross(z, x), z], axis=1)
    turn = cv2.Rodrigues(np.array([lean[0], lean[1], 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0.0, spin]))[0]
    return PlacedTag(name, number, distance * z, frame @ turn, side)


def true_pixels(camera: UnifiedCamera, tag: PlacedTag) -> Array:
    """(4, 2) [px] of the corners, NaN where not seen."""
    return camera.project(tag.corners())[0]


def render(camera, tags, *, blur=0.7, noise=2.0, seed=0, ground=None) -> npt.NDArray[np.uint8]:
    """(height, width) grey values; ``ground`` (h, w) is what stands behind the tags, default mottled."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    rng = np.random.default_rng(seed)
    behind = mottled(camera, rng) if ground is None else ground
    image = _greys(camera, tags, pixels, behind.ravel()).reshape(v.shape)
    plain = _greys(camera, tags, pixels, np.full(len(pixels), -1.0)).reshape(v.shape)
    edge = maximum_filter(plain, 3) != minimum_filter(plain, 3)
    shift = (np.arange(RAYS) + 0.5) / RAYS - 0.5
    grid = np.stack(np.meshgrid(shift, shift), -1)
    # sheared, so that an edge along the pixels is not always met by a whole row of rays
    grid = (grid + np.stack([grid[..., 1], -grid[..., 0]], -1) / RAYS).reshape(1, -1, 2)
    fine = (np.stack([u[edge], v[edge]], -1)[:, None, :] + grid).reshape(-1, 2)
    image[edge] = _greys(camera, tags, fine, np.repeat(behind[edge], RAYS**2)).reshape(-1, RAYS**2).mean(1)
    image = gaussian_filter(image, blur) if blur else image
    if noise:
        image = image + noise * rng.standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def mottled(camera: UnifiedCamera, rng: np.random.Generator) -> Array:
    """Rectangles of many greys and smooth stains (height, width): edges and corners that are no tags."""
    shape = (camera.height, camera.width)
    ground = 110.0 + 900.0 * gaussian_filter(rng.standard_normal(shape), 12.0)
    for _ in range(40):
        u, v = rng.uniform(0, shape[1]), rng.uniform(0, shape[0])
        size = tuple(rng.uniform(6, 60, 2))
        box = cv2.boxPoints(((u, v), size, rng.uniform(0, 90))).astype(np.int32)
        cv2.fillPoly(ground, [box], rng.uniform(10, 240))
    _, seen = camera.unproject(np.stack(np.meshgrid(*(np.arange(n, dtype=float) for n in shape[::-1])), -1))
    return np.where(seen, np.clip(ground, 5, 240), 0.0)


def _greys(camera, tags, pixels, behind):
    rays, valid = camera.unproject(pixels)
    greys = np.array(behind)
    nearest = np.full(len(pixels), np.inf)
    for tag in tags:
        pattern = tag.pattern()
        cells = len(pattern)
        reach, wider = tag.reach(), cells / tag_cells(tag.name)
        outline = tag.centre + 0.5 * tag.side * reach * CORNERS @ tag.axes[:, :2].T
        axis = tag.centre / np.linalg.norm(tag.centre)
        least = (outline @ axis / np.linalg.norm(outline, axis=1)).min()
        near = np.flatnonzero(valid & (rays @ axis >= least - 1e-9))
        normal = tag.axes[:, 2]
        distance = (tag.centre @ normal) / (rays[near] @ normal)
        place = 2.0 / tag.side * (distance[:, None] * rays[near] - tag.centre) @ tag.axes[:, :2]
        hit = (distance > 0) & (distance < nearest[near]) & (np.abs(place) <= reach).all(1)
        near, place = near[hit], place[hit]
        nearest[near] = distance[hit]
        column, row = (np.floor((place[:, k] / wider + 1.0) * cells / 2).astype(int) for k in range(2))
        inside = (np.minimum(column, row) >= 0) & (np.maximum(column, row) < cells)
        dark = inside & pattern[np.clip(row, 0, cells - 1), np.clip(column, 0, cells - 1)]
        greys[near] = np.where(dark, DARK, BRIGHT)
    return greys


def whole(camera: UnifiedCamera, tag: PlacedTag) -> bool:
    """Whether the tag is in the picture with its white border, at least a pixel from the picture's."""
    reach = tag.reach()
    places = np.stack(np.meshgrid(*[np.linspace(-reach, reach, 9)] * 2), -1).reshape(-1, 2)
    pixels, valid = camera.project(tag.centre + 0.5 * tag.side * places @ tag.axes[:, :2].T)
    if not valid.all():
        return False
    size = np.array([camera.width, camera.height])
    return bool(camera.in_image(pixels).all() and ((pixels >= 1) & (pixels <= size - 2)).all())
