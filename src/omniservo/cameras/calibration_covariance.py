"""How exactly a camera's parameters are known: the covariance that its calibration found."""

from __future__ import annotations

from typing import Any

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array

PARAMETERS = ("fx", "fy", "cx", "cy", "xi", "k1", "k2", "p1", "p2")
"""In the order of a calibration's covariance, which ends with xi where there is no distortion."""

CovarianceRows = tuple[tuple[float, ...], ...]

_ROUNDING = 1e-6
"""of a correlation, by which a matrix may miss being a covariance"""


def covariance_directions(covariance: Any) -> FloatArray:
    """Return independent directions (q, p) of the camera's parameters, one σ each: Σ dᵀd is the covariance.

    Raises:
        InputError: not (5, 5) or (9, 9), not symmetric, or with a negative eigenvalue.
    """
    matrix = finite_array("calibration_covariance", covariance, (None, None))
    if matrix.shape not in ((5, 5), (9, 9)):
        raise InputError(
            f"calibration_covariance: shape {matrix.shape} given; legal: (5, 5) of fx, fy, cx, cy, xi, or"
            " (9, 9) with k1, k2, p1, p2"
        )
    scale = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    units = np.where(scale > 0.0, scale, 1.0)
    even = matrix / np.outer(units, units)
    values, vectors = np.linalg.eigh(0.5 * (even + even.T))
    if np.abs(even - even.T).max() > _ROUNDING or values[0] < -_ROUNDING:
        raise InputError("calibration_covariance: a symmetric matrix without negative eigenvalues is needed")
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T * units)


def covariance_from(value: Any) -> CovarianceRows | None:
    """Return what a camera states of its parameters' covariance, as rows; None: nothing is stated.

    Raises:
        InputError: it is none.
    """
    if value is None:
        return None
    covariance_directions(value)
    return tuple(tuple(row) for row in np.asarray(value, dtype=np.float64).tolist())


def sigmas_in_words(covariance: CovarianceRows) -> str:
    """Return σ of each parameter, by name."""
    sigmas = np.sqrt(np.maximum(np.diag(np.array(covariance)), 0.0))
    return ", ".join(f"{name} ± {sigma:.2g}" for name, sigma in zip(PARAMETERS, sigmas, strict=False))
