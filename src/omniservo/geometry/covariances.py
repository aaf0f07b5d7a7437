"""What makes a matrix a covariance."""

import numpy as np

from omniservo.geometry.arrays import FloatArray

_ROUNDING = 1e-6
"""of correlations: numbers may have been written with six digits"""


def is_covariance(matrix: FloatArray) -> bool:
    """Return whether a matrix (n, n) is symmetric and has no negative eigenvalue, but for rounding.

    Rows may have units of their own: it is judged as correlations, whatever their sizes.
    """
    variances = np.diag(matrix)
    unit = np.sqrt(np.where(variances > 0.0, variances, 1.0))
    even = matrix / np.outer(unit, unit)
    return bool(
        variances.min() >= 0.0
        and np.abs(even - even.T).max() <= _ROUNDING
        and np.linalg.eigvalsh(even)[0] >= -_ROUNDING
    )
