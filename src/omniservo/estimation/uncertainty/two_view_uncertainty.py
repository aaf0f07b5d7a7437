"""From the optimum of two views to the joint law of motion and structure."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri

from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.cameras.conversion import UnifiedImage
from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import linear_structure
from omniservo.estimation.robust.members import PRIOR_NOISE_PX, PRIOR_WEIGHT
from omniservo.estimation.uncertainty.calibration_response import calibration_directions
from omniservo.estimation.uncertainty.camera_moves import CameraMoves
from omniservo.estimation.uncertainty.first_order import LinearResponse
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.estimation.uncertainty.likelihood_region import motion_offsets
from omniservo.estimation.uncertainty.shared_errors import shared_error_factor
from omniservo.estimation.uncertainty.structure_size import size_variance
from omniservo.estimation.uncertainty.sure_region import Others, sure_stretches
from omniservo.geometry.arrays import BoolArray, FloatArray

PROBABLE = 1e-3
"""A stated σ is accepted unless residuals as large as found have less than this probability."""

DOUBTFUL = 0.05
"""Where nothing is stated, what residuals leave beyond `PRIOR_NOISE_PX` is one noise of single pixels unless
it has less than this probability: it takes less to be less sure than to contradict who states something."""


class Noise(NamedTuple):
    """What is known of the pixels' noise."""

    variance: float
    """σ² of a coordinate of weight 1 [px²]"""
    freedom: float
    """degrees of freedom of σ; infinite where it was stated"""

    @classmethod
    def of(cls, weighted: float, freedom: int, stated: float | None) -> Noise:
        """Return what was stated, unless the residuals contradict it: Σ w²r² [px²] with so much freedom.

        With one or two degrees Student's law has no variance: they are joined with what is stated.
        """
        if stated is not None:
            if freedom == 0 or weighted <= stated**2 * float(chdtri(freedom, PROBABLE)):
                return cls(stated**2, math.inf)
            if freedom <= 2:
                weighted, freedom = weighted + PRIOR_WEIGHT * stated**2, freedom + int(PRIOR_WEIGHT)
        return cls(weighted / freedom, float(freedom))

    def in_common(self, members: Matches) -> Noise:
        """Return the noise of the motion; more than this one where nothing is stated of the matches'.

        Pixels are found to `PRIOR_NOISE_PX`. What residuals leave beyond that, and chance does not explain,
        need not be noise of each match by itself: matches that a motion bends to, of something that moved,
        err together. So it is taken not to fall with the number of matches.
        """
        if members.noise_px > 0.0 or math.isinf(self.freedom):
            return self
        usual = PRIOR_NOISE_PX**2 * float(chdtri(self.freedom, DOUBTFUL)) / self.freedom
        return self._replace(variance=self.variance + members.size * max(self.variance - usual, 0.0))

    def shared_by(self, response: FloatArray, members: Matches, windows: FloatArray | None) -> Noise:
        """Return the noise of the motion, whose matches share errors; see `shared_error_factor`."""
        noise = self.in_common(members)
        if windows is None:
            return noise
        factor = shared_error_factor(response, members.pixels, windows)
        return noise._replace(variance=noise.variance * factor)


class ScaleLength(NamedTuple):
    """What fixes the scale."""

    between: tuple[int, int] | None
    """members whose distance is known; None: the camera centres'"""
    metres: float
    """that distance; 1 where none is known"""

    def of_translation(self, points: FloatArray) -> float:
        """Return the length of t [m], the points (n, 3) being in lengths of t."""
        if self.between is None:
            return self.metres
        return self.metres / float(np.linalg.norm(points[self.between[0]] - points[self.between[1]]))


class Lens(NamedTuple):
    """How far the camera may be off: its parameters, and its model's error, alike over regions."""

    camera: UnifiedCamera
    directions: FloatArray
    """(q, p) independent, one σ each"""
    factor: float = 1.0
    """by which the model's error is taken larger than stated, since residuals ask for it"""

    @classmethod
    def of(cls, image: UnifiedImage, covariance: npt.ArrayLike | None) -> Lens:
        """Return the directions of a covariance; None: of the camera's own, if it states one.

        Raises:
            InputError: an illegal covariance, or one of parameters that the camera does not have.
        """
        if covariance is not None:
            image.refuse_parameters("calibration_covariance")
        return cls(image.camera, calibration_directions(image.camera, covariance))

    @property
    def error(self) -> ModelError | None:
        """The model's error; None where it is none."""
        stated = self.camera.model_error
        return stated if stated is not None and stated.sigma_px > 0.0 else None

    @property
    def sigma_px(self) -> float:
        """σ of the model's error [px]."""
        return 0.0 if self.error is None else self.error.sigma_px

    def whole_noise(self, noise: FloatArray) -> FloatArray:
        """Return σ [px] of pixels with this ``noise``, the model's error added in quadrature."""
        return np.hypot(noise, self.sigma_px) if self.error is not None else noise

    def moves(self, members: Matches) -> FloatArray:
        """Return the model's independent errors (f, n, 4) [px] at the pixels of both images."""
        if self.error is None:
            return np.empty((0, members.size, 4))
        return self.factor * self.error.moves(members.pixels)

    def all_moves(self, members: Matches, solution: Solution) -> CameraMoves:
        """Return what errors of parameters and model do to the pixels (n, 4) of both images."""
        rotation, translation, points = solution
        seen = np.stack((points, (points - translation) @ rotation), axis=1)
        return CameraMoves.of(self.camera, seen, members.pixels, self.directions, self.factor)


class Solution(NamedTuple):
    """The optimum, in lengths of t."""

    rotation: FloatArray
    translation: FloatArray
    points: FloatArray


class Responses(NamedTuple):
    """How the optimum answers displaced pixels, in units of their noise."""

    whole: LinearResponse
    """in σ of the whole noise of each match"""
    alone: LinearResponse
    """in σ of the noise that it has for itself"""


def two_view_uncertainty(
    members: Matches,
    others: Others | None,
    responses: Responses,
    solution: Solution,
    noise: Noise,
    together: Noise,
    length: ScaleLength,
    lens: Lens,
) -> JointUncertainty:
    """Return the law of x in metres.

    A camera whose projections differ by ∂π/∂θ dθ shows the estimate pixels that are displaced by −∂π/∂θ dθ:
    implicit differentiation by the same response as to noise.

    Args:
        members: the matches of the fit.
        others: motions beside the optimum; None: that is of another cost, whose valleys are not checked.
        responses: at the optimum.
        solution: the optimum.
        noise: of the pixels of one match.
        together: what counts as theirs where all matches act on the motion.
        length: what fixes the scale.
        lens: how well the camera is known.
    """
    response, (rows, own) = responses.whole, responses.alone.law()
    metres = length.of_translation(solution.points)
    unit = np.full(rows.shape[1], metres)
    unit[3:6] = 1.0
    noisy = math.sqrt(together.variance) * unit * rows
    sigma = None
    if others is not None:
        stretched = _stretched(members, others, response, solution, together, length)
        noisy = np.concatenate((noisy, stretched))
        sigma = math.sqrt(together.variance) / members.weights if len(stretched) else None
    weights = np.repeat(members.weights, 2, axis=1)
    moves, directions = lens.all_moves(members, solution)
    calibration = np.array([response.answer(-weights * m) for m in moves]).reshape(-1, rows.shape[1])
    own = noise.variance * metres**2 * own
    spread = together.variance * response.unscaled
    size = size_variance(members, solution.rotation, solution.translation, spread, length.between)
    return JointUncertainty(noisy, own, noise.freedom, unit * calibration, directions, sigma, size)


def total_covariances(
    law: JointUncertainty, scale_sigma: float, translation: FloatArray, points: FloatArray, members: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the covariances (6, 6) of (t, δ) and (n, 3, 3) of all points [m]; NaN for other than members."""
    motion, each = law.covariances()
    whole, seen = np.concatenate((translation, np.zeros(3))), points[members]
    points_covariance = np.full((len(points), 3, 3), math.nan)
    points_covariance[members] = each + scale_sigma**2 * seen[:, :, None] * seen[:, None, :]
    return motion + scale_sigma**2 * np.outer(whole, whole), points_covariance


def _stretched(
    members: Matches,
    others: Others,
    response: LinearResponse,
    solution: Solution,
    noise: Noise,
    length: ScaleLength,
) -> FloatArray:
    """Return the rows (k, 6 + 3n) [m] that stretch the law over what the likelihood leaves.

    See `sure_stretches`; the points follow by their linear structure.
    """
    rotation, translation, points = solution
    far = sure_stretches(members, (rotation, translation), others, response.unscaled, *noise)
    rows = np.empty((len(far.weights), 6 + points.size))
    if not len(rows):
        return rows
    here, metres = _structure(members, rotation, translation, length)
    turns = motion_offsets(rotation, translation, far.rotations, far.translations)[:, 3:]
    for k, weight in enumerate(far.weights):
        there, other = _structure(members, far.rotations[k], far.translations[k], length)
        moved = np.where(np.isfinite(there - here), there - here, 0.0)
        # To first order a direction changes across t, and the length of t along it.
        across = far.translations[k] - (far.translations[k] @ translation) * translation
        shift = metres * across + (other - metres) * translation
        rows[k] = math.sqrt(weight) * np.concatenate((shift, turns[k], moved.ravel()))
    return rows


def _structure(
    members: Matches, rotation: FloatArray, translation: FloatArray, length: ScaleLength
) -> tuple[FloatArray, float]:
    """Return the linear structure (n, 3) [m] under a motion, and the length of t [m]."""
    points = np.empty((len(members.pixels), 3))
    linear_structure(members.bearings, rotation, translation, points)
    metres = length.of_translation(points)
    return metres * points, metres
