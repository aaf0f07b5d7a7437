"""Points of an image where two dark and two bright sectors meet, without any knowledge of the board."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray

Grey = npt.NDArray[np.float32]

_SAMPLES = 32  # on the ring
_RADII = (3.0, 4.5)  # [px of the level] of the rings; the smallest squares have sides of about 6 px
_MOST = 6000  # candidates a level
_LEAST_CONTRAST = 8.0  # grey values between the ring's bright and dark sectors
_LEAST_SECTOR = np.deg2rad(18.0)
_OPPOSITE = np.deg2rad(40.0)  # how far the two halves of an edge may bend away from one line


@dataclass(frozen=True)
class Saddles:
    """Candidates for corners between four squares."""

    pixels: FloatArray
    """(n, 2) [px]"""
    edges: FloatArray
    """(n, 4) [rad] directions of the four half edges, ascending from −π: atan2(dv, du)"""
    first_is_bright: BoolArray
    """(n,) whether the sector between half edges 0 and 1 is bright; the sectors alternate"""
    contrast: FloatArray
    """(n,) grey values between bright and dark sectors"""

    def __len__(self) -> int:
        return len(self.pixels)


def saddle_candidates(image: ByteArray, scales: tuple[float, ...] = (1.0, 0.5, 0.25)) -> Saddles:
    """Find candidates in several sizes of the image; a point found in a finer one is kept there.

    A candidate is a local maximum of −det of the Hessian of the smoothed image, and a ring around it
    crosses exactly four edges, of which opposite ones lie on one line.

    Args:
        image: (height, width) grey values.
        scales: sizes, finest first; 2 doubles the image.
    """
    found = [_of_level(image, scale) for scale in scales]
    pixels, edges, bright, contrast = (np.concatenate([part[k] for part in found]) for k in range(4))
    reach = np.concatenate([np.full(len(f[0]), 2.5 / s) for f, s in zip(found, scales, strict=True)])
    kept = _first_of_each_place(pixels, reach)
    return Saddles(pixels[kept], edges[kept], bright[kept], contrast[kept])


def _of_level(image: ByteArray, scale: float) -> tuple[FloatArray, FloatArray, BoolArray, FloatArray]:
    size = (max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1))
    kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    level = image.astype(np.float32)
    if scale != 1.0:
        level = cv2.resize(level, size, interpolation=kind)
    smooth = cv2.GaussianBlur(level, (0, 0), 1.2)
    points = _hessian_saddles(smooth)
    edges, bright, contrast, good = _ring(smooth, points, _RADII[0])
    for radius in _RADII[1:]:  # a larger ring tells the directions better, where it sees one corner alone
        wider, wider_bright, wider_contrast, better = _ring(smooth, points, radius)
        edges[better], bright[better], contrast[better] = (
            wider[better],
            wider_bright[better],
            wider_contrast[better],
        )
        good |= better
    # pixel centres: cv2.resize keeps the image's corners, at −½
    factor = np.array([image.shape[1] / size[0], image.shape[0] / size[1]])
    pixels = (points[good] + 0.5) * factor - 0.5
    return pixels, edges[good], bright[good], contrast[good]


def _hessian_saddles(smooth: Grey) -> FloatArray:
    """Sub-pixel positions (n, 2) where −det of the Hessian has a local maximum."""
    uu = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3)
    vv = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3)
    uv = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    # Sobel's kernels of size 3 sum to 4 for a second difference, 4 for the mixed one
    saddle = uv * uv - uu * vv
    peak = (saddle == cv2.dilate(saddle, np.ones((5, 5), np.uint8))) & (saddle > 4.0)
    margin = 3
    peak[:margin], peak[-margin:], peak[:, :margin], peak[:, -margin:] = False, False, False, False
    v, u = np.nonzero(peak)
    if len(u) > _MOST:
        strongest = np.argsort(-saddle[v, u], kind="stable")[:_MOST]
        v, u = v[strongest], u[strongest]
    g = (
        np.stack(
            [
                cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)[v, u],
                cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)[v, u],
            ],
            1,
        ).astype(np.float64)
        / 8.0
    )
    a, b, c = (np.float64(x[v, u]) / 4.0 for x in (uu, uv, vv))
    det = np.minimum(a * c - b * b, -1e-12)
    step = np.stack([-(c * g[:, 0] - b * g[:, 1]) / det, -(a * g[:, 1] - b * g[:, 0]) / det], 1)
    near = np.abs(step).max(axis=1, initial=0.0) <= 2.0
    return np.asarray(np.stack([u, v], 1)[near] + step[near])


def _ring(
    smooth: Grey, points: FloatArray, radius: float
) -> tuple[FloatArray, BoolArray, FloatArray, BoolArray]:
    """Half edges (n, 4), first sector bright (n,), contrast (n,), and whether the ring is a corner's (n,)."""
    angles = -np.pi + 2 * np.pi * (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    u = points[:, :1] + radius * np.cos(angles)
    v = points[:, 1:] + radius * np.sin(angles)
    grey = sample(smooth, u, v)
    ordered = np.sort(grey, axis=1)
    low, high = ordered[:, : _SAMPLES // 6].mean(1), ordered[:, -(_SAMPLES // 6) :].mean(1)
    level = grey - 0.5 * (low + high)[:, None]
    after = np.roll(level, -1, axis=1)
    crosses = (level > 0) != (after > 0)
    good = (crosses.sum(1) == 4) & (high - low >= _LEAST_CONTRAST)
    edges = np.zeros((len(points), 4))
    at = np.nonzero(crosses[good])[1].reshape(-1, 4)
    here, there = (np.take_along_axis(x[good], at, 1) for x in (level, after))
    edges[good] = angles[at] + here / (here - there) * (2 * np.pi / _SAMPLES)
    bright = np.zeros(len(points), dtype=bool)
    bright[good] = np.take_along_axis(after[good], at[:, :1], 1)[:, 0] > 0
    sectors = np.diff(np.concatenate([edges, edges[:, :1] + 2 * np.pi], axis=1), axis=1)
    bend = np.abs(edges[:, 2:] - edges[:, :2] - np.pi)
    good &= (sectors.min(1) >= _LEAST_SECTOR) & (bend.max(1) <= _OPPOSITE)
    return edges, bright, high - low, good


def sample(image: Grey, u: FloatArray, v: FloatArray) -> FloatArray:
    """Bilinear values of a float32 image at pixels of any shape; beyond the border the border's value."""
    flat_u = np.ascontiguousarray(u.reshape(1, -1) if u.ndim == 1 else u, dtype=np.float32)
    flat_v = np.ascontiguousarray(v.reshape(1, -1) if v.ndim == 1 else v, dtype=np.float32)
    out = np.zeros(flat_u.shape, dtype=np.float64)
    rows = 16384  # cv2.remap's coordinates are 16 bits
    for start in range(0, len(flat_u), rows):
        part = slice(start, start + rows)
        out[part] = cv2.remap(
            image, flat_u[part], flat_v[part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
    return out.reshape(u.shape)


def _first_of_each_place(pixels: FloatArray, reach: FloatArray) -> BoolArray:
    """Drop points within ``reach`` (n,) [px] of an earlier one."""
    kept = np.ones(len(pixels), dtype=bool)
    if len(pixels) == 0:
        return kept
    tree = cKDTree(pixels)
    for i, near in enumerate(tree.query_ball_point(pixels, reach)):
        if any(k < i and kept[k] for k in near):
            kept[i] = False
    return kept
