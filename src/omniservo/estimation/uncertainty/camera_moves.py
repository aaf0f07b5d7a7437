"""What a camera that differs from its statement does to the pixels of an estimate: parameters and model."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel
from omniservo.estimation.uncertainty.calibration_response import calibration_directions, pixel_slopes
from omniservo.geometry.arrays import FloatArray


def stated_directions(camera: CentralModel) -> FloatArray:
    """Return independent directions (q, p) of the parameters' stated covariance; (0, 5): it states none."""
    return calibration_directions(camera, None) if isinstance(camera, UnifiedCamera) else np.empty((0, 5))


def is_exact(camera: CentralModel) -> bool:
    """Tell whether a camera states no error at all."""
    error = camera.model_error
    return (error is None or error.sigma_px == 0.0) and not len(stated_directions(camera))


def parameter_moves(camera: CentralModel, seen: FloatArray, directions: FloatArray) -> FloatArray:
    """Return by how much pixels move (q, …, 2) [px] of camera points (…, 3) for each direction (q, p)."""
    if not len(directions) or not isinstance(camera, UnifiedCamera):
        return np.zeros((len(directions), *seen.shape[:-1], 2))
    slopes = pixel_slopes(camera, seen, directions.shape[1])
    return np.asarray(np.einsum("...p,qp->q...", slopes, directions))


def camera_variance(camera: CentralModel, bearings: FloatArray) -> FloatArray:
    """Return the variance (n,) [px²] that a camera's errors give residuals of a pose, at bearings (n, 3).

    That of the model's error, and of the parameters beside the best small rotation of all bearings, which
    every pose absorbs.
    """
    sigma_px = 0.0 if camera.model_error is None else camera.model_error.sigma_px
    variance, moves = np.full(len(bearings), sigma_px**2), np.empty(0)
    if len(directions := stated_directions(camera)):
        moves = parameter_moves(camera, bearings, directions)
    if moves.size:
        turns = np.cross(camera.project_jacobian(bearings)[1], bearings[:, None, :]).reshape(-1, 3)
        rows = moves.reshape(len(moves), -1)
        rows = rows - np.linalg.lstsq(turns, rows.T, rcond=None)[0].T @ turns.T
        variance += np.square(rows).sum(axis=0).reshape(-1, 2).mean(axis=1)
    return variance


class CameraMoves(NamedTuple):
    """Independent errors of a camera, one σ each: first those of its parameters, then of its model."""

    pixels: FloatArray
    """(f, n, 2v) by how much pixels differ from what the stated camera shows [px], of v images of n points"""
    parameters: FloatArray
    """(f, p) by how much the parameters do; 0 for the model's errors"""

    @classmethod
    def of(
        cls,
        camera: CentralModel,
        seen: FloatArray,
        pixels: FloatArray,
        directions: FloatArray | None = None,
        factor: float = 1.0,
    ) -> CameraMoves:
        """Return them; none where the camera states none.

        Args:
            camera: of any model; the parameters of a `UnifiedCamera` alone have a covariance.
            seen: (n, v, 3) [m] the points in the camera of each image.
            pixels: (n, 2v) [px] where the model's error is taken.
            directions: (q, p) of the parameters, one σ each; None: as the camera states them.
            factor: by which the model's error is taken larger than stated.
        """
        directions = stated_directions(camera) if directions is None else directions
        moves = parameter_moves(camera, seen, directions).reshape(len(directions), *pixels.shape)
        error = camera.model_error
        if error is not None and error.sigma_px > 0.0:
            moves = np.concatenate((moves, factor * error.moves(pixels)))
        still = np.zeros((len(moves) - len(directions), directions.shape[1]))
        return cls(moves, np.concatenate((directions, still)))

    def through(self, response: FloatArray) -> FloatArray:
        """Return what they do (f, k) to an estimate that answers displaced pixels by (n, k, 2v)."""
        return np.asarray(np.einsum("fnc,nkc->fk", self.pixels, response, optimize=True))
