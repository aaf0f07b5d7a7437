"""Products that most kernels of two and more views take: coordinates in another camera."""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf


@leaf
def times(m: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the product of a 3×3 matrix and (x, y, z)."""
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@leaf
def transposed_times(m: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the product of a transposed 3×3 matrix and (x, y, z)."""
    return (
        m[0, 0] * x + m[1, 0] * y + m[2, 0] * z,
        m[0, 1] * x + m[1, 1] * y + m[2, 1] * z,
        m[0, 2] * x + m[1, 2] * y + m[2, 2] * z,
    )
