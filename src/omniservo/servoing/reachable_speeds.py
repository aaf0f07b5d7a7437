"""The fastest path speeds by reachability analysis (TOPP-RA).

Import it where it is called: toppra loads Matplotlib's pyplot, which nothing else here needs.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from toppra.algorithm import TOPPRA
from toppra.constraint import JointAccelerationConstraint, JointVelocityConstraint, LinearConstraint

from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.path_limits import PathLimits


def reachable_speeds(limits: PathLimits, grid: FloatArray) -> FloatArray | None:
    """Return the greatest ẇ (m,) [1/s] at the grid (m,) from rest to rest; None where the library finds none.

    Between two places of the grid ẅ is constant; the limits are kept at both of its ends.
    Pham and Pham, A New Approach to Time-Optimal Path Parameterization Based on Reachability Analysis, 2018.
    """
    constraints = [
        JointVelocityConstraint(limits.speeds),
        JointAccelerationConstraint(limits.accelerations),
        _PathSpeedConstraint(limits),
    ]
    search = TOPPRA(constraints, _Path(limits), gridpoints=grid, solver_wrapper="seidel")
    _, speeds, _ = search.compute_parameterization(0.0, 0.0)
    if speeds is None or not np.isfinite(speeds).all():
        return None
    return np.asarray(speeds, dtype=np.float64)


class _Path:
    """A path as toppra asks for it."""

    def __init__(self, limits: PathLimits) -> None:
        self._limits = limits
        self.dof = len(limits.speeds)
        self.path_interval = np.array([0.0, 1.0])

    def __call__(self, w: Any, order: int = 0) -> FloatArray:
        return self._limits.joints(np.asarray(w, dtype=np.float64), order)


class _PathSpeedConstraint(LinearConstraint):  # type: ignore[misc]  # toppra has no types
    """ẇ² within what `PathLimits.top_path_speed` allows."""

    def __init__(self, limits: PathLimits) -> None:
        super().__init__()
        self._limits = limits
        self.dof = len(limits.speeds)

    def compute_constraint_params(self, path: Any, gridpoints: FloatArray) -> tuple[Any, ...]:
        top = self._limits.top_path_speed(np.asarray(gridpoints, dtype=np.float64))
        bound = np.column_stack([np.zeros(len(top)), np.minimum(top, _FASTEST) ** 2])
        return None, None, None, None, None, None, bound


_FASTEST = 1e4
"""[1/s] instead of infinity"""
