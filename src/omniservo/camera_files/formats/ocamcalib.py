"""OCamCalib's calib_results.txt: the polynomial, its inverse, centre, affine part and size, in five rows.

With OCamCalib's x down the rows and y along the columns: (row, column) = [[c, d], [e, 1]] (x, y) + centre,
and the ray is (x, y, a0 + a1ρ + a2ρ² + …), whose z points backwards. Our axes are (its y, its x, −its z),
so that (u, v) = [[1, e], [d, c]] (x, y) + (centre column, centre row). The centre counts from 0 at a
pixel's centre ("C convention").
Source: D. Scaramuzza's toolbox, ``cam2world`` and ``world2cam`` of ocam_functions.c.

The inverse polynomial is only an approximation of the first, in powers of θ = atan(z/ρ): it is not read,
and fitted when a file is written, to 0.01 px where a degree up to 32 reaches that; the file says how close
it is. Near the fold of the first it cannot come close: there ρ(θ) has an infinite slope.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from omniservo.camera_files.calibration_file import CalibrationFile, lens_comment
from omniservo.cameras.models import CentralModel, OcamPolynomial
from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import FloatArray

KINDS: tuple[type, ...] = (OcamPolynomial,)

_DEGREES = range(4, 33, 2)
_INVERSE_PX = 0.01


def recognises(fields: Any) -> bool:
    """Say whether the rows are a count with as many numbers, twice, and then anything."""
    rows = fields.get("rows")
    return (
        isinstance(rows, list)
        and len(rows) >= 2
        and all(isinstance(row, list) for row in rows)
        and isinstance(next(iter(rows[0]), None), int)
        and all(not isinstance(value, str) for row in rows[:2] for value in row)
    )


def names(file: CalibrationFile) -> list[str]:
    """Return the names of the file's cameras: one, which has none."""
    return [""]


def read(file: CalibrationFile, name: str) -> OcamPolynomial:
    """Return the camera.

    Raises:
        InputError: a row is missing or has not its numbers.
    """
    counts = {2: "centre: row and column", 3: "affine part: c, d, e", 4: "image size: height and width"}
    rows = file.value("rows")
    for index in range(2):
        if rows[index][0] != len(rows[index]) - 1 or rows[index][0] < 1:
            raise file.error(
                f"a polynomial of {spelled(rows[index][0])} numbers, but {len(rows[index]) - 1} follow",
                "rows",
                index,
            )
    for index, what in counts.items():
        if index >= len(rows):
            raise file.error(f"missing; needed: {what}", "rows", index)
    coefficients = file.numbers(len(rows[0]), "rows", 0)[1:]
    row, column = file.numbers(2, "rows", 2)
    c, d, e = file.numbers(3, "rows", 3)
    height, width = file.numbers(2, "rows", 4)
    size = file.image_size((width, height), "rows", 4)
    return file.build(OcamPolynomial, coefficients=coefficients, cx=column, cy=row, **size, stretch=(c, d, e))


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the file's text, with OCamCalib's comments.

    Raises:
        InputError: another model.
    """
    if not isinstance(model, OcamPolynomial):
        raise InputError(f"format 'ocamcalib' cannot hold a {type(model).__name__}")
    direct, (inverse, deviation) = list(model.coefficients), inverse_polynomial(model)
    rows: dict[str, list[float]] = {
        "polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB)": direct,
        "polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB), within"
        f" {deviation:.2g} px of the direct one in the image": inverse,
        'center: "row" and "column", starting from 0 (C convention)': [model.cy, model.cx],
        'affine parameters "c", "d", "e"': list(model.stretch),
        'image size: "height" and "width"': [model.height, model.width],
    }
    counted = {what: [len(row), *row] if "polynomial" in what else row for what, row in rows.items()}
    text = "\n\n".join(f"#{what}\n\n{' '.join(map(repr, row))}" for what, row in counted.items())
    return f"{text}\n\n{lens_comment(model)}"


def inverse_polynomial(model: OcamPolynomial) -> tuple[list[float], float]:
    """Return the coefficients of ρ(θ) [px], θ = atan(z/ρ) with OCamCalib's z, −π/2 on the axis.

    Least squares over every ρ in the image that the model can use, of the lowest degree that leaves at most
    0.01 px.

    Returns:
        the coefficients, lowest power first; the largest deviation that they leave [px].
    """
    sides = np.meshgrid([-0.5, model.width - 0.5], [-0.5, model.height - 0.5])
    corners = np.column_stack([side.ravel() for side in sides]) - [model.cx, model.cy]
    c, d, e = model.stretch
    farthest = np.linalg.norm(np.linalg.solve([[1.0, e], [d, c]], corners.T), axis=0).max()
    rho = np.linspace(0.0, farthest, 2000)
    theta: FloatArray = np.arctan2(np.polynomial.polynomial.polyval(rho, np.array(model.coefficients)), rho)
    ends = np.flatnonzero((theta > model.usable_angle - np.pi / 2) | (np.diff(theta, prepend=-np.pi) <= 0.0))
    count = max(int(ends[0]) if len(ends) else len(rho), _DEGREES.stop)
    for degree in _DEGREES:
        fit = np.polynomial.Polynomial.fit(theta[:count], rho[:count], degree)
        inverse = fit.convert().coef
        left = np.polynomial.polynomial.polyval(theta[:count], inverse) - rho[:count]
        deviation = float(np.abs(left).max())
        if deviation <= _INVERSE_PX:
            break
    return [float(value) for value in inverse], deviation
