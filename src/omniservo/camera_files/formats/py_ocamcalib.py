"""The JSON file of py-OCamCalib: ``taylor_coefficient`` a0 … aN, ``distortion_center``, ``stretch_matrix``.

With x to the right and y down (u, v) = [[c, d], [e, 1]] (x, y) + centre, and the ray is (x, y, a0 + a1ρ +
a2ρ² + …), whose z points ahead. In `ocamcalib`'s form, where u stretches by 1, lengths are c times as large:
(u, v) = [[1, d/c], [e/c, 1/c]] (x', y') + centre, and z' = −Σ aᵢ c^(1 − i) ρ'^i points backwards.
The file does not say the image's size; (0, 0) is a pixel's centre. Its inverse polynomial is an approximation
and is not read. Source: jakarto3d/py-OCamCalib, ``cam2world`` of ``modelling/camera.py``. Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import OcamPolynomial

_MOST = 33
"""coefficients"""


def recognises(fields: Any) -> bool:
    """Say whether the fields are a camera of py-OCamCalib."""
    return "taylor_coefficient" in fields


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which needs none."""
    return [""]


def read(file: CalibrationFile, name: str) -> OcamPolynomial:
    """Return the camera.

    Raises:
        InputError: a field is missing or not legal.
    """
    series = file.coefficients("taylor_coefficient", legal=tuple(range(1, _MOST + 1)))
    cx, cy = file.numbers(2, "distortion_center")
    c, d = file.numbers(2, "stretch_matrix", 0, nonzero=(0,))
    e, one = file.numbers(2, "stretch_matrix", 1)
    if one != 1.0:
        raise file.error(f"{one:g} given; legal: [[c, d], [e, 1]]", "stretch_matrix", 1)
    return file.build(
        OcamPolynomial,
        coefficients=tuple(-a * c ** (1 - i) for i, a in enumerate(series)),
        cx=cx,
        cy=cy,
        **file.image_size(),
        stretch=(1.0 / c, e / c, d / c),
    )
