"""Tags found, read, and located to hundredths of a pixel in raw wide-angle images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from omniservo.cameras.models.central_model import CentralModel
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray, owned
from omniservo.perception.find_dots import check_image, noise_of
from omniservo.perception.image_points import ImagePoints
from omniservo.perception.tag_candidates import candidate_planes, read_cells
from omniservo.perception.tag_codes import TagCodes, likeliest_code, tag_codes
from omniservo.perception.tag_fit import (
    LEAST_CONTRAST,
    TagFit,
    corner_covariance,
    corner_pixels,
    fit_border,
    fit_code,
)
from omniservo.perception.tag_views import field_views

_INSIDE = 0.7
"""a square whose middle lies so far inside a tag that was read is that tag again, or a part of it"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class FoundTags:
    """The tags of one image, by id."""

    ids: IntArray
    """(k,) ascending"""
    corners: FloatArray
    """(k, 4, 2) [px] of the square: top left, top right, bottom right, bottom left as printed"""
    covariance: FloatArray
    """(k, 4, 2, 2) [px²] of the corners' errors"""
    repeated: IntArray
    """ids that were read at more than one place: it is unknown which is meant, so they are not in ``ids``"""

    def __len__(self) -> int:
        return len(self.ids)

    @cached_property
    def points(self) -> ImagePoints:
        """The corners as points with ids 4·id + corner."""
        ids = (4 * self.ids[:, None] + np.arange(4)).ravel()
        return ImagePoints(self.corners.reshape(-1, 2), self.covariance.reshape(-1, 2, 2), ids)


def find_tags(image: ByteArray, camera: CentralModel, dictionary: str = "tag36h11") -> FoundTags:
    """Find every whole tag of a dictionary.

    Squares are looked for in the raw image and, with a wide field, in perspective views that cover it;
    each is fitted to the raw image's grey values, first by its rim, then with its code (`tag_fit`). A tag
    counts where every cell of its code agrees at the fitted place, blur taken into account; one that the
    image's border, the lens's rim or a dead zone cuts is none, nor is one of more than 1500 px a side (of an
    AprilTag 3 family that of the whole print). The corners are those of the square between
    the dark ring and the bright one, in which or round which the code stands.

    Args:
        image: (height, width) grey values, uint8.
        camera: the camera that took it, of any model. One whose image is a mirror's needs a focal length < 0.
        dictionary: tag16h5 … tag36h11, 4x4_50 … 7x7_1000, tagStandard41h12 …; see `dictionary_names`.

    Raises:
        InputError: not such an image, not of the camera's size, or no such dictionary.
    """
    check_image(image, camera)
    codes = tag_codes(dictionary)
    planes = candidate_planes(image, camera, codes.layout, field_views(camera))
    return tags_of(camera, read_tags(np.ascontiguousarray(image), camera, codes, planes))


def read_tags(
    image: ByteArray, camera: CentralModel, codes: TagCodes, planes: FloatArray
) -> list[tuple[int, TagFit]]:
    """Return id and fit of the tags at candidate planes (n, 3, 3), each place once."""
    found: list[tuple[int, TagFit]] = []
    noise = noise_of(image)
    for plane in planes:
        middle = np.linalg.solve(plane, [0.0, 0.0, 1.0])
        if any(_contains(fit, middle) for _, fit in found):
            continue
        read = _read(image, camera, codes, plane, noise)
        if read is not None:
            found.append(read)
    return found


def tags_of(camera: CentralModel, found: list[tuple[int, TagFit]]) -> FoundTags:
    """Return located tags; those whose corners are not all seen are left out."""
    rows = []
    for number, fit in found:
        pixels = corner_pixels(camera, fit)
        covariance = None if pixels is None else corner_covariance(camera, fit, pixels)
        if covariance is not None:
            rows.append((number, pixels, covariance))
    rows.sort(key=lambda row: row[0])
    numbers = np.array([number for number, *_ in rows], dtype=np.int64)
    value, times = np.unique(numbers, return_counts=True)
    once = np.isin(numbers, value[times == 1])
    corners = np.array([pixels for _, pixels, _ in rows]).reshape(-1, 4, 2)[once]
    covariance = np.array([covariance for *_, covariance in rows]).reshape(-1, 4, 2, 2)[once]
    return FoundTags(_held(numbers[once]), owned(corners), owned(covariance), _held(value[times > 1]))


def _read(
    image: ByteArray, camera: CentralModel, codes: TagCodes, plane: FloatArray, noise: float
) -> tuple[int, TagFit] | None:
    greys = read_cells(image, camera, plane, codes.layout)
    if greys is None or np.ptp(greys) < LEAST_CONTRAST:
        return None
    border = fit_border(image, camera, plane, codes.layout)
    greys = None if border is None else read_cells(image, camera, border.plane, codes.layout)
    code = None if greys is None else likeliest_code(codes, greys)
    if border is None or code is None:
        return None
    number, turn = code
    fit = fit_code(image, camera, turned(border.plane, turn), codes, number)
    return (number, fit) if fit is not None and fit.agrees(noise) else None


def turned(plane: FloatArray, turn: int) -> FloatArray:
    """Return the plane of the same square whose corner 0 is what was corner −turn."""
    cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[turn]
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) @ plane


def _contains(fit: TagFit, ray: FloatArray) -> bool:
    q = fit.plane @ ray
    return bool(q[2] > 0 and np.abs(q[:2]).max() < _INSIDE * q[2])


def _held(numbers: IntArray) -> IntArray:
    numbers = np.array(numbers, dtype=np.int64)
    numbers.setflags(write=False)
    return numbers
