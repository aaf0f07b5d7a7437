"""Rotation: ‖φ(w)‖² − 0.01 ≥ 0, so that R(w) is well defined; degree 2σ."""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import magnitude
from omniservo.geometry.subdivision import prove_nonnegative
from omniservo.planning.bernstein_path import squares


@kernel
def prove_rotation(rotation: FloatArray, floor: float) -> tuple[int, float]:
    """Decide ‖φ(w)‖² ≥ floor on [0, 1] for φ given by powers (4, σ+1)."""
    square, _ = squares(rotation)
    for k in range(square.shape[1]):
        square[0, k] -= floor
    size = magnitude(rotation)
    count = 3.0 * (square.shape[1] - 1) + 13.0
    return prove_nonnegative(square, count, 4.0 * size * size + abs(floor))
