"""Where tags may be: squares, dark or ringed by dark, in the raw image and in views without bent sides."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from omniservo.cameras.models.central_model import CentralModel
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.perception.tag_fit import CORNERS, LEAST_CONTRAST, bearings_of, planes_of
from omniservo.perception.tag_views import TagView
from omniservo.tag_dictionaries import TagLayout

_BLOCKS = (7, 15, 31, 63)
"""sides of the squares whose mean is the threshold [px]: about a cell, for tags of every size"""
_DARKER = 5.0
"""grey values than that mean"""
_LEAST_OUTLINE_PX = 44
"""smaller squares have no code that can be read; noise is full of them"""
_LEAST_SIDE_PX = 7.0
_BENT = 0.07
"""a square of a wide-angle image has bent sides: deviation from a polygon, in perimeters"""
_STRAIGHT = 0.04
_MOST_CANDIDATES = 400
_RIM_SHARE = 0.8
"""of the places along the sides that must be darker inside than outside"""
_MOST_SQUARES = 2000
"""of one image or view; more are noise, the largest are kept"""
_SAME = 0.03
"""of a square's diagonal: middles and diagonals so near are those of one square"""
_RIM = np.linspace(-0.8, 0.8, 9)


def candidate_planes(
    image: ByteArray,
    camera: CentralModel,
    layout: TagLayout,
    views: tuple[TagView, ...],
    *,
    raw: bool = True,
) -> FloatArray:
    """Return planes G (n, 3, 3) (see `tag_fit`) of prints whose square has its rim, the clearest first.

    Args:
        image: (height, width) grey values.
        camera: the camera that took it.
        layout: of the tags.
        views: to be searched as well.
        raw: search the raw image.
    """
    found = [view.bearings(_squares(view.resampled(image), _STRAIGHT)) for view in views]
    if raw:
        found.append(_raw_squares(image, camera))
    edge = layout.border / layout.cells
    planes = planes_of(np.concatenate([np.zeros((0, 4, 3)), *found]), edge)
    return _clearest(image, camera, planes, layout)


def _raw_squares(image: ByteArray, camera: CentralModel) -> FloatArray:
    """Corner bearings (n, 4, 3) of squares in the raw image, reflected back where the camera reflects."""
    mirrored = _shows_mirrored(camera)
    seen = np.ascontiguousarray(image[:, ::-1]) if mirrored else image
    pixels = _squares(seen, _BENT)
    if mirrored:
        pixels[..., 0] = image.shape[1] - 1 - pixels[..., 0]
    bearings, valid = camera.unproject(pixels)
    return np.asarray(bearings[valid.all(axis=1)])


def _squares(image: ByteArray, accuracy: float) -> FloatArray:
    """Corners (n, 4, 2) [px], clockwise, of the outlines of dark regions that are convex quadrangles.

    OpenCV's own reader keeps one of several squares inside each other, so a tag with a thin white border is
    lost to it now and then.
    """
    found = []
    for block in _BLOCKS:
        method, kind = cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV
        dark = cv2.adaptiveThreshold(image, 255, method, kind, block, _DARKER)
        outlines, _ = cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        for outline in outlines:
            if len(outline) < _LEAST_OUTLINE_PX:
                continue
            corners = cv2.approxPolyDP(outline, accuracy * len(outline), closed=True)
            if len(corners) == 4 and cv2.isContourConvex(corners):
                found.append(corners[:, 0])
    squares = np.array(found, dtype=np.float64).reshape(-1, 4, 2)
    sides = np.linalg.norm(squares - np.roll(squares, 1, axis=1), axis=2).min(axis=1, initial=np.inf)
    order = np.argsort(-sides, kind="stable")[:_MOST_SQUARES]
    squares = squares[order][sides[order] >= _LEAST_SIDE_PX]
    first, second = squares[:, 1] - squares[:, 0], squares[:, 2] - squares[:, 0]
    clockwise = first[:, 0] * second[:, 1] > first[:, 1] * second[:, 0]
    return np.asarray(np.where(clockwise[:, None, None], squares, squares[:, ::-1]))


def _clearest(image: ByteArray, camera: CentralModel, planes: FloatArray, layout: TagLayout) -> FloatArray:
    """The planes whose square has a dark rim inside a bright one, or the other way round, by contrast."""
    if not len(planes):
        return planes
    rim = [_ring((layout.border - 1.0) / layout.cells), _ring((layout.border + 1.0) / layout.cells)]
    if layout.bright_inside:
        rim.reverse()
    places = np.column_stack([np.concatenate(rim), np.ones(2 * len(rim[0]))])
    rays = np.linalg.solve(planes, np.broadcast_to(places.T, (len(planes), 3, len(places)))).swapaxes(1, 2)
    pixels, valid = camera.project(rays)
    greys = _sampled(image, np.where(valid[..., None], pixels, -1.0))
    inside, outside = np.split(greys, 2, axis=1)
    higher = outside - inside
    contrast = np.median(higher, axis=1)
    share = (higher > 0.4 * contrast[:, None]).mean(axis=1)
    good: BoolArray = valid.all(axis=1) & (contrast >= LEAST_CONTRAST) & (share >= _RIM_SHARE)
    order = np.argsort(-(share * contrast)[good], kind="stable")[:_MOST_CANDIDATES]
    return _each_once(planes[good][order])


def _each_once(planes: FloatArray) -> FloatArray:
    """Without squares that are almost an earlier one: found in several views, or by several thresholds."""
    kept: list[int] = []
    rays = np.linalg.solve(planes, np.column_stack([CORNERS, np.ones(4)]).T[None]).swapaxes(1, 2)
    rays = rays / np.linalg.norm(rays, axis=2, keepdims=True)
    middle = rays.mean(axis=1)
    side = np.linalg.norm(rays[:, 0] - rays[:, 2], axis=1)
    for k in range(len(planes)):
        away = np.linalg.norm(middle[kept] - middle[k], axis=1)
        if not ((away < _SAME * side[k]) & (np.abs(side[kept] - side[k]) < _SAME * side[k])).any():
            kept.append(k)
    return np.asarray(planes[kept])


def _ring(half: float) -> FloatArray:
    """Places (36, 2) on the sides of the square of this half side."""
    sides: Iterator[FloatArray] = (
        0.5 * ((1.0 - _RIM[:, None]) * a + (1.0 + _RIM[:, None]) * b)
        for a, b in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True)
    )
    return half * np.concatenate(list(sides))


def read_cells(
    image: ByteArray, camera: CentralModel, plane: FloatArray, layout: TagLayout
) -> FloatArray | None:
    """Return the grey values (bits,) of the code's cells of a print, None where one is not seen."""
    middle = (2.0 * np.argwhere(layout.code)[:, ::-1] + 1.0) / layout.cells - 1.0
    offset = 0.4 / layout.cells * np.array([[0.0, 0.0], [-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    places = (middle[:, None] + offset).reshape(-1, 2)
    pixels, valid = camera.project(bearings_of(plane, places))
    if not valid.all():
        return None
    return np.asarray(_sampled(image, pixels).reshape(-1, len(offset)).mean(axis=1))


def _sampled(image: ByteArray, pixels: FloatArray) -> FloatArray:
    """Bilinear grey values (…) at pixels (…, 2)."""
    flat = pixels.reshape(len(pixels), -1, 2).astype(np.float32)
    greys = cv2.remap(image, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(greys, dtype=np.float64).reshape(pixels.shape[:-1])


def _shows_mirrored(camera: CentralModel) -> bool:
    """Whether the image shows the world reflected: one of the focal lengths is negative."""
    ahead = camera.project(np.array([[0.0, 0.0, 1.0], [1e-4, 0.0, 1.0], [0.0, 1e-4, 1.0]]))[0]
    across = ahead[1:] - ahead[0]
    return bool(across[0, 0] * across[1, 1] < across[0, 1] * across[1, 0])
