"""What an estimate of several views rests on: enough to work out its law, also with a view more."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.estimation.refinement.view_adjustment import ViewProblem, ViewState
from omniservo.estimation.uncertainty.view_uncertainty import (
    ModelErrors,
    ViewNoise,
    ViewResponse,
    ViewUncertainty,
)
from omniservo.estimation.view_scale import GaugeLength
from omniservo.geometry.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class AdjustedViews:
    """The views that have a pose and the points that have a place, at the minimum."""

    problem: ViewProblem
    state: ViewState
    length: GaugeLength | None
    """what fixes the scale; None: displacements do"""
    noise: ViewNoise
    window: FloatArray | None
    """(v, m) as `ViewPoints.window`"""
    directions: FloatArray
    """(q, p) of the camera's parameters, one σ each"""

    def law(self) -> ViewUncertainty | None:
        """Return the law of poses and points; None where the views do not determine them."""
        response = ViewResponse.at(self.problem, self.state)
        if response is None:
            return None
        return self.law_of(response, ModelErrors.of(error_of(self.problem.camera), self.problem, response))

    def law_of(self, response: ViewResponse, errors: ModelErrors) -> ViewUncertainty:
        """Return it, of what was worked out before."""
        factor = 1.0
        if self.window is not None:
            factor = response.window_factor(self.problem.pixels, self.window)
        return ViewUncertainty.of_response(response, self.state, self.length, errors, self.noise, factor)


def error_of(camera: UnifiedCamera) -> ModelError | None:
    """Return the error of a camera's model, None where there is none."""
    error = camera.model_error
    return error if error is not None and error.sigma_px > 0.0 else None
