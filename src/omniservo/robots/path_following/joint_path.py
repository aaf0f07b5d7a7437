"""The joints that carry a camera along a path, on one branch, and where they cannot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen_again
from omniservo.robots.path_following.quintic import pieces_between, quintic_pieces, quintic_values
from omniservo.short_repr import short_repr

FailureKind = Literal["limit", "singular", "jump"]


@with_field_docs
@dataclass(frozen=True)
class PathFailure:
    """What stops a branch."""

    kind: FailureKind
    """limit: the joint leaves its range. singular: the camera's smallest singular value falls below what the
    arm inverts (`omniservo.robots.arm.SINGULAR_VALUE`); the branch ends. jump: the joints cannot follow the
    camera without a jump, because its path or its speed has one; the branch ends."""
    joint: str
    """limit: that passes it. singular: that turns most in the motion which hardly moves the camera. jump: the
    largest."""
    w: float
    """where it begins"""
    amount: float
    """limit: how far the joint passes it at most [rad]. singular: what the singular value lacks. jump: how
    far the joint is off where its speed leads [rad]."""
    worst_w: float
    """where it is that much"""

    def __str__(self) -> str:
        """Return one line for people."""
        if self.kind == "limit":
            size = f"{np.rad2deg(self.amount):.2f} deg"
            return (
                f"{self.joint} passes its limit from w = {self.w:.4f} on, by {size} at w = {self.worst_w:.4f}"
            )
        if self.kind == "singular":
            lack = f"the smallest singular value lacks {self.amount:.2g}"
            return f"singular at w = {self.w:.4f}: {self.joint}; {lack}"
        return f"{self.joint} would jump at w = {self.w:.4f} by {np.rad2deg(self.amount):.2g} deg"


@with_field_docs
@dataclass(frozen=True, eq=False)
class JointPath:
    """q(w) on one branch, at samples, and between them as quintics; w in [0, 1], or to where the branch ends.

    At the samples the camera is on its path within 1e-9 m and rad; half way between them within 1e-6 m and
    rad. With w(t): q̇ = q′ẇ and q̈ = q″ẇ² + q′ẅ, so ``velocities`` and ``accelerations`` are what a time law
    needs.
    """

    w: FloatArray
    """(m,) samples, closer where the joints turn sharply"""
    positions: FloatArray
    """(m, n) q [rad], continuous; of the full turns the one that leaves most room to the limits, or those
    of the stated start"""
    velocities: FloatArray
    """(m, n) dq/dw [rad]: joint speed per unit of path speed"""
    accelerations: FloatArray
    """(m, n) d²q/dw² [rad]"""
    singular_values: FloatArray
    """(m,) smallest singular value of the camera Jacobian, linear rows over
    `omniservo.robots.arm.LENGTH_SCALE`"""
    limit_margins: FloatArray
    """(m, n) distance to the nearer end of the range [rad], negative outside"""
    failures: tuple[PathFailure, ...]
    """by w; none: the arm can follow"""
    travel: float
    """the time that the joint with the farthest way needs for it at its nominal speed [s]"""

    __repr__ = short_repr
    __setstate__ = frozen_again

    @property
    def feasible(self) -> bool:
        """Whether the branch leads to w = 1 within the limits, without singularity or jump."""
        return not self.failures

    def __call__(self, w: npt.ArrayLike, order: int = 0) -> FloatArray:
        """Return q (…, n), dq/dw or d²q/dw² [rad] for w of any shape (…).

        Raises:
            InputError: w outside the samples, not finite, or another order than 0, 1, 2.
        """
        at = finite_array("w", w, np.shape(w))
        if order not in (0, 1, 2):
            raise InputError(f"order: {order!r} given; legal: 0, 1, 2")
        if at.size and (at.min() < self.w[0] or at.max() > self.w[-1]):
            raise InputError(
                f"w: {at.min():g} to {at.max():g} given; this branch goes from 0 to {self.w[-1]:g}"
            )
        if len(self.w) == 1:
            values = (self.positions, self.velocities, self.accelerations)[order]
            return np.broadcast_to(values[0], (*at.shape, values.shape[1])).copy()
        values = quintic_values(self.w, self._pieces, np.ascontiguousarray(at.reshape(-1)), order)
        return values.reshape(*at.shape, values.shape[1])

    def bernstein_pieces(self, begin: float = 0.0, end: float = 1.0) -> tuple[FloatArray, FloatArray]:
        """Return where the quintic pieces begin and end (k + 1,), and their coefficients (k, 6, n) [rad].

        Of a part without length, as where a path ends: one piece that stands still.

        Args:
            begin: where the first piece begins, if not with the path.
            end: where the last one ends, if not with the path.

        Raises:
            InputError: not finite, ``begin`` behind ``end``, or none of it on the path.
        """
        first = max(finite_number("begin", begin), float(self.w[0]))
        last = min(finite_number("end", end), float(self.w[-1]))
        if first > last:
            raise InputError(
                f"begin, end: {begin:g}, {end:g} given; this branch goes from {self.w[0]:g} to {self.w[-1]:g}"
            )
        if first == last:
            return np.array([first, last]), np.tile(self(first), (1, 6, 1))
        if first == self.w[0] and last == self.w[-1]:
            return self.w, self._pieces
        return pieces_between(self.w, self._pieces, first, last)

    @cached_property
    def _pieces(self) -> FloatArray:
        return quintic_pieces(self.w, self.positions, self.velocities, self.accelerations)
