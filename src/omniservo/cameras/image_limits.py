"""Every limit of an image as a circular cone of points in the camera frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.distorted_mask import mask_on_plane
from omniservo.cameras.distorted_region import convex_polygon, dead_zone_on_plane, smallest_scale
from omniservo.cameras.image_mask import outward_edges
from omniservo.cameras.model_domain import cosine_of_radius, model_domain, radius_of_angle
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number

if TYPE_CHECKING:
    from omniservo.cameras.unified_camera import UnifiedCamera

_SAFE_SIDE = 1e-15
"""on the cosine of max_angle: the cone errs inwards"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class ImageLimits:
    """The set of points c that a camera shows with a margin: n_i·c ≤ κ_i ‖c‖ for every i.

    A line a x + b y ≤ e on the normalised plane m = (X, Y)/(Z + ξρ) is the cone n = (a, b, −e), κ = e ξ.
    So is every image edge of a camera without distortion; a circle about the axis is −Z ≤ −cos θ ρ.
    The model's domain comes first: without it, points behind the camera fold into the image.
    """

    normals: FloatArray
    """n (k, 3), finite, not unit; in the camera frame; read-only"""
    kappas: FloatArray
    """κ (k,), read-only"""
    names: tuple[str, ...]
    """(k,) "domain", then "left edge", "right edge", "top edge", "bottom edge" and, where the camera states
    it, "max_angle"; for a distorted camera instead of these "polygon 0", "polygon 1", …"""
    dead_zone: DeadZone | None
    """Grown by the margin; a disc [px] in the image K m of the undistorted plane. Points are outside it."""
    mask: tuple[FloatArray, ...]
    """Of every polygon of the mask, grown by the margin, the edges' lines (k, 3): unit n and b [px]. A pixel
    is outside where n·p ≥ b for one of them. For a distorted camera lines in the image K m, and only of
    those polygons of which ``polygon`` shows anything"""
    polygon: FloatArray | None
    """For a distorted camera: (k−1, 2) corners of a convex polygon on the plane m, counter-clockwise, inside
    the region that the image shows with the margin; else None"""

    @cached_property
    def cones(self) -> FloatArray:
        """Rows (n, κ)/‖n‖ (k, 4), as compiled code takes them: not to be written to."""
        rows = np.column_stack([self.normals, self.kappas])
        cones: FloatArray = rows / np.linalg.norm(self.normals, axis=1, keepdims=True)
        return cones


def image_limits(camera: UnifiedCamera, margin_px: float = 0.0) -> ImageLimits:
    """Return the limits of the camera's image, every one moved inward by ``margin_px`` [px].

    Edges move by the margin itself. The ``max_angle`` circle shrinks on the plane m by margin/σ, with σ
    the smaller singular value of K's 2×2 block, so that what is left is at least the margin inside in the
    image. Dead zones and masks grow. The domain does not move.

    Raises:
        InputError: the margin is negative or leaves nothing of the image.
    """
    margin = finite_number("margin_px", margin_px, minimum=0.0)
    half = min(camera.width, camera.height) / 2.0
    if margin >= half:
        raise InputError(f"margin_px: {margin:g} given; legal: less than {half:g}, half the image")
    return _distorted_limits(camera, margin) if camera.is_distorted else _straight_limits(camera, margin)


@lru_cache(maxsize=128)
def _straight_limits(camera: UnifiedCamera, margin: float) -> ImageLimits:
    fx, fy, s, xi = camera.fx, camera.fy, camera.skew, camera.xi
    left, right = camera.cx + 0.5 - margin, camera.width - 0.5 - margin - camera.cx
    top, bottom = camera.cy + 0.5 - margin, camera.height - 0.5 - margin - camera.cy
    rows = [
        (0.0, 0.0, -1.0, -model_domain(xi)[0]),
        (-fx, -s, -left, left * xi),
        (fx, s, -right, right * xi),
        (0.0, -fy, -top, top * xi),
        (0.0, fy, -bottom, bottom * xi),
    ]
    names: tuple[str, ...] = ("domain", "left edge", "right edge", "top edge", "bottom edge")
    if camera.max_angle is not None:
        rows.append((0.0, 0.0, -1.0, -_least_cosine(camera, camera.max_angle, margin)))
        names = (*names, "max_angle")
    zone = camera.dead_zone
    grown = None if zone is None else DeadZone(zone.center, zone.radius + margin)
    masks = tuple(outward_edges(polygon, margin) for polygon in camera.mask)
    return _limits(np.array(rows), names, grown, masks, None)


def _least_cosine(camera: UnifiedCamera, angle: float, margin: float) -> float:
    """Return cos θ of the circle at ``angle`` moved inward by the margin, rounded up."""
    cosine = max(math.cos(angle), model_domain(camera.xi)[0])
    if margin > 0.0:
        radius = radius_of_angle(camera.xi, angle) - margin / smallest_scale(camera)
        if radius <= 0.0:
            raise InputError(f"margin_px: {margin:g} given; it leaves nothing inside the max_angle circle")
        cosine = max(cosine, cosine_of_radius(camera.xi, radius)) if math.isfinite(radius) else cosine
    return cosine + _SAFE_SIDE


@lru_cache(maxsize=128)
def _distorted_limits(camera: UnifiedCamera, margin: float) -> ImageLimits:
    polygon = convex_polygon(camera, margin)
    along = np.roll(polygon, -1, axis=0) - polygon
    a, b = along[:, 1], -along[:, 0]
    e = a * polygon[:, 0] + b * polygon[:, 1]
    domain = (0.0, 0.0, -1.0, -model_domain(camera.xi)[0])
    rows = np.vstack([domain, np.column_stack([a, b, -e, e * camera.xi])])
    names = ("domain", *(f"polygon {i}" for i in range(len(polygon))))
    zone = None if camera.dead_zone is None else dead_zone_on_plane(camera, camera.dead_zone, margin)
    covers = (mask_on_plane(camera, corners, margin, polygon) for corners in camera.mask)
    masks = tuple(cover for cover in covers if cover is not None)
    return _limits(rows, names, zone, masks, polygon)


def _limits(
    rows: FloatArray,
    names: tuple[str, ...],
    zone: DeadZone | None,
    masks: tuple[FloatArray, ...],
    polygon: FloatArray | None,
) -> ImageLimits:
    normals, kappas = rows[:, :3].copy(), rows[:, 3].copy()
    for array in (normals, kappas, *masks, *(() if polygon is None else (polygon,))):
        array.setflags(write=False)
    return ImageLimits(normals, kappas, names, zone, masks, polygon)
