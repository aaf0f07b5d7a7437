"""How a family pushes the search at one sample.

A constraint with dimensionless value g (≥ 0 where it holds) and target μ has the residual r = max(0, μ − g).
With g ≈ g + a·ξ for a small camera motion ξ = (linear, angular) in the camera frame, active rows add up to
one normal equation of the sample: ``system`` (6, 7) = [Σ a aᵀ, Σ a r]. A row's price does not depend on the
degree of the path. Every pushing function returns its Σ r²/2 and lowers ``least``, the smallest g so far.

``pose`` (13,) is R row by row, then t, then ‖φ‖².
"""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel


@kernel
def push_row(
    system: FloatArray, a0: float, a1: float, a2: float, a3: float, a4: float, a5: float, r: float
) -> float:
    """Add the row a with residual r to the upper triangle; return r²/2."""
    row = (a0, a1, a2, a3, a4, a5)
    for i in range(6):
        a = row[i]
        for j in range(i, 6):
            system[i, j] += a * row[j]
        system[i, 6] += a * r
    return 0.5 * r * r


@kernel
def push_centre(system: FloatArray, pose: FloatArray, x: float, y: float, z: float, r: float) -> float:
    """Add a row that depends on t alone: ∂g/∂t = (x, y, z) in the reference frame; return r²/2."""
    a0 = pose[0] * x + pose[3] * y + pose[6] * z
    a1 = pose[1] * x + pose[4] * y + pose[7] * z
    a2 = pose[2] * x + pose[5] * y + pose[8] * z
    row = (a0, a1, a2)
    for i in range(3):
        a = row[i]
        for j in range(i, 3):
            system[i, j] += a * row[j]
        system[i, 6] += a * r
    return 0.5 * r * r


@kernel
def push_camera_point(system: FloatArray, c: FloatArray, gx: float, gy: float, gz: float, r: float) -> float:
    """Add a row that depends on a point c in the camera frame: ∂g/∂c = (gx, gy, gz); return r²/2.

    dc = −linear − angular × c, so a = (−∂g/∂c, −c × ∂g/∂c).
    """
    return push_row(
        system,
        -gx,
        -gy,
        -gz,
        c[2] * gy - c[1] * gz,
        c[0] * gz - c[2] * gx,
        c[1] * gx - c[0] * gy,
        r,
    )
