"""What a time law must keep along a joint path."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.geometry.kernel import kernel

HURRY = 30.0
"""A path is nowhere run through faster than so many times its mean speed, if that is the unit."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class PathLimits:
    """Joint speeds and accelerations along q(w), and whatever else bounds ẇ: q̇ = q′ẇ, q̈ = q″ẇ² + q′ẅ.

    Raises:
        InputError: wrong shapes, or a limit that is not positive and finite.
    """

    joints: Callable[[FloatArray, int], FloatArray]
    """of w (m,) in [0, 1] and an order 1 or 2: dq/dw, d²q/dw² (m, n); `omniservo.robots.JointPath` is one"""
    speeds: FloatArray
    """(n,) greatest |q̇|"""
    accelerations: FloatArray
    """(n,) greatest |q̈|"""
    path_speed: Callable[[FloatArray], FloatArray] | None = None
    """of w (m,): greatest ẇ [1/s] (m,), infinite where nothing bounds it; None: the joints alone do"""

    def __post_init__(self) -> None:
        for name in ("speeds", "accelerations"):
            limits = finite_array(f"limits.{name}", getattr(self, name), (None,))
            if not len(limits) or limits.min() <= 0.0:
                raise InputError(f"limits.{name}: {limits} given; every limit must be > 0")
            object.__setattr__(self, name, frozen(limits))
        if len(self.speeds) != len(self.accelerations):
            raise InputError(
                f"limits: {len(self.speeds)} speeds and {len(self.accelerations)} accelerations given"
            )

    def in_units(self, angle: float, time: float) -> PathLimits:
        """Return the same limits with ``angle`` [rad] and ``time`` [s] in place of a radian and a second.

        ẇ is at most `HURRY` of these units: where the joints stand still, nothing else may bound it.
        """
        joints, top, speed = self.joints, self.top_path_speed, time / angle
        return PathLimits(
            lambda w, order: joints(w, order) / angle,
            speed * self.speeds,
            time * speed * self.accelerations,
            lambda w: np.minimum(time * top(w), HURRY),
        )

    def rates(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return dq/dw and d²q/dw² (m, n) at w (m,).

        Raises:
            InputError: what ``joints`` gives is not finite or of another shape.
        """
        first, second = (
            finite_array(f"limits.joints(w, {order})", self.joints(w, order), (len(w), len(self.speeds)))
            for order in (1, 2)
        )
        return first, second

    def top_path_speed(self, w: FloatArray) -> FloatArray:
        """Return the greatest ẇ that ``path_speed`` allows (m,) [1/s]; infinite where nothing bounds it.

        Raises:
            InputError: ``path_speed`` gives NaN, zero, a negative number, or another shape.
        """
        if self.path_speed is None:
            return np.full(len(w), np.inf)
        top = np.asarray(self.path_speed(w), dtype=np.float64)
        if top.shape != w.shape or not (top > 0.0).all():
            raise InputError("limits.path_speed: one number > 0 is needed for every w")
        return top

    def excess(self, w: FloatArray, speed: FloatArray, acceleration: FloatArray) -> float:
        """Return by how much time must be stretched for the motion (w, ẇ, ẅ), (m,) each, to keep all limits.

        Stretched by κ, speeds are divided by κ and accelerations by κ²: 1 means that a limit is just met.
        """
        return self.at(w).excess(speed, acceleration)

    def at(self, w: FloatArray) -> LimitsAt:
        """Return the limits at w (m,), looked up once for many motions through these places.

        Raises:
            InputError: as `rates` and `top_path_speed`.
        """
        first, second = self.rates(w)
        return LimitsAt(first, second, self.top_path_speed(w), self.speeds, self.accelerations)


class LimitsAt(NamedTuple):
    """Joint rates and limits at m places."""

    first: FloatArray
    """(m, n) dq/dw"""
    second: FloatArray
    """(m, n) d²q/dw²"""
    top: FloatArray
    """(m,) greatest ẇ of the path itself [1/s]"""
    speeds: FloatArray
    """(n,) greatest |q̇|"""
    accelerations: FloatArray
    """(n,) greatest |q̈|"""

    def excess(self, speed: FloatArray, acceleration: FloatArray) -> float:
        """Return `PathLimits.excess` of a motion with ẇ, ẅ (m,) at these places."""
        found: float = _excess(self, speed, acceleration)
        return found


@kernel
def _excess(limits: LimitsAt, speed: FloatArray, acceleration: FloatArray) -> float:
    by_speed, by_acceleration = 0.0, 0.0
    for k in range(speed.shape[0]):
        by_speed = max(by_speed, speed[k] / limits.top[k])
        for j in range(limits.speeds.shape[0]):
            rate = limits.first[k, j] * speed[k]
            change = limits.second[k, j] * speed[k] * speed[k] + limits.first[k, j] * acceleration[k]
            by_speed = max(by_speed, abs(rate) / limits.speeds[j])
            by_acceleration = max(by_acceleration, abs(change) / limits.accelerations[j])
    return max(by_speed, math.sqrt(by_acceleration))
