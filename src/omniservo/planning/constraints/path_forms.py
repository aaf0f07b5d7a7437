"""A path in the forms that proofs want."""

from typing import NamedTuple

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import bernstein_from_power, magnitude
from omniservo.planning.bernstein_path import squares


class PathForms(NamedTuple):
    """A path in the forms that proofs want."""

    rotation: FloatArray
    """φ by powers (4, σ+1), highest first"""
    translation: FloatArray
    """t by powers (3, τ+1) [m], highest first"""
    centre: FloatArray
    """t by Bernstein coefficients (3, τ+1) [m]"""
    square: FloatArray
    """‖t‖² (1, 2τ+1) [m²], see `squares`"""
    raised: FloatArray
    """t of the same degree (3, 2τ+1) [m]"""
    size: float
    """the magnitude of t [m]"""


@kernel
def path_forms(rotation: FloatArray, translation: FloatArray) -> PathForms:
    """Return a path given by powers (4, σ+1), (3, τ+1) in all forms."""
    square, raised = squares(translation)
    centre = bernstein_from_power(translation)
    return PathForms(rotation, translation, centre, square, raised, magnitude(translation))


class ViewForms(NamedTuple):
    """A path as the camera sees every target point, see `camera_controls`."""

    controls: FloatArray
    """c(w) by Bernstein coefficients (n, 3, d+1)"""
    errors: FloatArray
    """error per rounding (n,)"""
    roundings: float
    """how many, see `camera_count`"""
