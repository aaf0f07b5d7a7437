"""How far an arm reaches."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

from omniservo.geometry.arrays import FloatArray

_STARTS = 12


def farthest(distance: Callable[[FloatArray], tuple[float, FloatArray]], joint_range: FloatArray) -> float:
    """Return the largest value found of a distance over the joints' ranges (n, 2).

    Args:
        distance: of joints (n,): its value [m] and gradient (n,) [m/rad].
        joint_range: [rad]
    """

    def nearness(q: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = distance(q)
        return -value, -gradient

    bounds = [(float(low), float(high)) for low, high in joint_range]
    random = np.random.default_rng(0)
    starts = random.uniform(joint_range[:, 0], joint_range[:, 1], (_STARTS, len(joint_range)))
    found = []
    for start in starts:
        result = minimize(nearness, start, jac=True, method="L-BFGS-B", bounds=bounds)
        found.append(-float(result.fun))
    return max(found)
