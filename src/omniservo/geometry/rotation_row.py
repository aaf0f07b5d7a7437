"""A rotation as nine numbers of a row: its matrix R row by row."""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf

XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ = range(9)
"""the places of R's numbers, row and column"""


@leaf
def turned(R: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return R (x, y, z)."""
    return (
        float(R[XX] * x + R[XY] * y + R[XZ] * z),
        float(R[YX] * x + R[YY] * y + R[YZ] * z),
        float(R[ZX] * x + R[ZY] * y + R[ZZ] * z),
    )


@leaf
def turned_back(R: FloatArray, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return Rᵀ (x, y, z)."""
    return (
        float(R[XX] * x + R[YX] * y + R[ZX] * z),
        float(R[XY] * x + R[YY] * y + R[ZY] * z),
        float(R[XZ] * x + R[YZ] * y + R[ZZ] * z),
    )
