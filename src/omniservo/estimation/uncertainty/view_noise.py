"""What the residuals of several views say of the pixels' noise, beside the camera's error in them."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import chdtri

from omniservo.estimation.refinement.view_adjustment import ViewProblem
from omniservo.estimation.robust.pose_search import PRIOR_NOISE_PX, PRIOR_WEIGHT
from omniservo.estimation.uncertainty.shared_camera_error import LARGEST_EXCESS, LEAST_SHARE
from omniservo.estimation.uncertainty.two_view_uncertainty import PROBABLE
from omniservo.estimation.uncertainty.view_uncertainty import ModelErrors, ViewNoise, ViewResponse
from omniservo.geometry.arrays import FloatArray

CONTRADICTED = "the residuals contradict the stated errors of pixels and camera"


def view_noise(
    square: float, problem: ViewProblem, response: ViewResponse, errors: ModelErrors, own: FloatArray | None
) -> ViewNoise:
    """Return the noise of whitened pixels.

    Of independent noise with variance ρ² and of model errors that leave residuals r_f,
    E[Σr²] = ρ²ν + Σ‖r_f‖² and Var[Σr²] = 2(ρ⁴ν + 2ρ²Σ‖r_f‖² + Σ (r_f·r_g)²).

    Args:
        square: Σr² at the minimum.
        problem: what was measured.
        response: at the minimum.
        errors: of the camera's model.
        own: (k,) of each pixel that counts, its stated noise over its whole one; None: nothing was stated.
    """
    freedom = 2.0 * float((problem.weights > 0.0).sum()) - response.parameters
    shown = math.sqrt(square / max(freedom, 1.0))
    if own is None:
        left = max(square - errors.squares, LEAST_SHARE * square)
        if freedom <= 2.0:  # they say too little about σ, and are joined with what is usual
            prior = (PRIOR_NOISE_PX * float(problem.weights.max())) ** 2
            freedom = PRIOR_WEIGHT + max(freedom, 0.0)
            return ViewNoise(math.sqrt((PRIOR_WEIGHT * prior + left) / freedom), freedom, shown)
        return ViewNoise(math.sqrt(left / freedom), freedom, shown)
    variance = float(np.mean(np.square(own)))
    expected = variance * freedom + errors.squares
    if len(errors.common):
        inner = float(np.square(errors.inner).sum())
        spread = 2.0 * (variance**2 * freedom + 2.0 * variance * errors.squares + inner)
        fits = square <= expected + LARGEST_EXCESS * math.sqrt(max(spread, 0.0))
    else:
        fits = square <= variance * float(chdtri(max(freedom, 1.0), PROBABLE))
    if fits:
        return ViewNoise(math.sqrt(variance), math.inf, shown)
    raised = math.sqrt(square / expected)
    words = f"{CONTRADICTED}, which are taken {raised:.2g} times as large" if len(errors.common) else ""
    return ViewNoise(raised * math.sqrt(variance), math.inf, shown, raised, words)
