"""WoodScape's and SynWoodScape's calibration JSON: a radius in px that is a polynomial of the angle.

r = k1 θ + k2 θ² + k3 θ³ + k4 θ⁴, (u, v) = (cx_offset + (width − 1)/2, cy_offset + (height − 1)/2) plus r in
the point's direction, its vertical part times aspect_ratio; (0, 0) is a pixel's centre. Source:
``scripts/calibration/projection.py`` of WoodScape. Read only.

Even powers are in none of our models: the Kannala–Brandt camera that comes closest over the image is
returned, and how far it is off at most is its ``deviation_px``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import KannalaBrandt
from omniservo.geometry.arrays import FloatArray

_SAMPLES = 2000


def recognises(fields: Any) -> bool:
    """Say whether the fields have an intrinsic part with a model, as WoodScape's."""
    held = fields.get("intrinsic")
    return isinstance(held, Mapping) and "model" in held


def names(file: CalibrationFile) -> list[str]:
    """Return the name of the file's one camera: FV, RV, MVL or MVR."""
    return [str(file.fields.get("name", ""))]


def read(file: CalibrationFile, name: str) -> KannalaBrandt:
    """Return the camera.

    Raises:
        InputError: another model, a field is missing or not legal, or r does not grow over the image.
    """
    file.word(("radial_poly",), "intrinsic", "model")
    sides = tuple(file.number("intrinsic", side, minimum=1.0) for side in ("width", "height"))
    size = file.image_size(sides, "intrinsic", "width")
    series = np.array([0.0, *(file.number("intrinsic", f"k{i}") for i in (1, 2, 3, 4))])
    aspect = file.number("intrinsic", "aspect_ratio", minimum=1e-3)
    cx, cy = (
        file.number("intrinsic", f"c{axis}_offset") + 0.5 * (side - 1.0)
        for axis, side in zip("xy", sides, strict=True)
    )
    corner = math.hypot(max(cx, sides[0] - cx), max(cy, sides[1] - cy) / aspect)
    theta = _angles(series, corner)
    if theta[-1] == 0.0:
        raise file.error("the radius does not grow with the angle; legal: k1 > 0", "intrinsic", "k1")
    focal, k, off = _closest(theta, np.polynomial.polynomial.polyval(theta, series))
    return file.build(
        KannalaBrandt, fx=focal, fy=focal * aspect, cx=cx, cy=cy, **size, k=k,
        max_angle=float(theta[-1]), deviation_px=off * max(1.0, aspect),
    )  # fmt: skip


def _angles(series: FloatArray, corner: float) -> FloatArray:
    """Return angles from 0 to the image's farthest corner, or to where r no longer grows."""
    theta = np.linspace(0.0, math.pi * (1.0 - 1e-6), 8 * _SAMPLES)
    radius = np.polynomial.polynomial.polyval(theta, series)
    ends = np.flatnonzero((np.diff(radius) <= 0.0) | (radius[1:] > corner))
    return np.linspace(0.0, theta[int(ends[0]) if len(ends) else -1], _SAMPLES)


def _closest(theta: FloatArray, radius: FloatArray) -> tuple[float, tuple[float, ...], float]:
    """Return the focal length, k1…k4 of least squares, and what they leave at most [px]."""
    powers = theta[:, None] ** np.arange(1, 10, 2)
    found = np.linalg.lstsq(powers, radius, rcond=None)[0]
    left = float(np.abs(powers @ found - radius).max())
    return float(found[0]), tuple((found[1:] / found[0]).tolist()), left
