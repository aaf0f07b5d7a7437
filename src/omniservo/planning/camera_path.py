"""The planned path of the camera (23)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, overload

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen


@dataclass(frozen=True, eq=False)
class CameraPath:
    """φ(w) = Ũ [w^σ … w 1]ᵀ, t(w) = Ṽ [w^τ … w 1]ᵀ, R = Λ(φ)/‖φ‖² for w in [0, 1] (23), (20).

    {R(w), t(w)} is the camera's pose in the initial camera frame. φ is not normalised.

    Raises:
        InputError: another shape, or not finite.
    """

    rotation: FloatArray
    """Ũ (4, σ+1), rows x, y, z, w, highest power first; read-only"""
    translation: FloatArray
    """Ṽ (3, τ+1) [m], highest power first; read-only"""

    def __post_init__(self) -> None:
        for name, rows in (("rotation", 4), ("translation", 3)):
            array = finite_array(f"path.{name}", getattr(self, name), (rows, None))
            if array.shape[1] < 1:
                raise InputError(f"path.{name}: no coefficients given")
            object.__setattr__(self, name, frozen(array))

    @overload
    def __call__(self, w: npt.ArrayLike, order: Literal[0] = 0) -> RigidTransform: ...
    @overload
    def __call__(self, w: npt.ArrayLike, order: Literal[1, 2]) -> FloatArray: ...

    def __call__(self, w: npt.ArrayLike, order: int = 0) -> RigidTransform | FloatArray:
        """Return pose, twist, or the twist's derivative at w, an array of any shape (…).

        Args:
            w: path parameter.
            order: 0: initial_T_camera(w), a RigidTransform of shape (…). 1: the camera's twist
                (v, ω) (…, 6) [m], [rad] per unit w in the camera frame, v = Rᵀt′,
                ω = 2 vec(φ* ⊗ φ′)/‖φ‖² (so that R′ = R[ω]×). 2: its derivative with respect to w,
                v′ = Rᵀt″ − ω × v, ω′ = (2 vec(φ* ⊗ φ″) − (‖φ‖²)′ ω)/‖φ‖².

        Raises:
            InputError: w is not finite, or another order.
        """
        at = finite_array("w", w, np.shape(w))
        phi = _values(self.rotation, at, 0)
        rotation = Rotation.from_quat(phi)
        if order == 0:
            return RigidTransform.from_components(self.positions(at), rotation)
        if order not in (1, 2):
            raise InputError(f"order: {order!r} given; legal: 0, 1, 2")
        back = rotation.inv()
        slope = _values(self.rotation, at, 1)
        square = np.sum(phi * phi, axis=-1, keepdims=True)
        linear = back.apply(_values(self.translation, at, 1))
        angular = 2.0 * _vector_of_product(phi, slope) / square
        if order == 1:
            return np.concatenate([linear, angular], axis=-1)
        growth = 2.0 * np.sum(phi * slope, axis=-1, keepdims=True)
        turn = 2.0 * _vector_of_product(phi, _values(self.rotation, at, 2))
        return np.concatenate(
            [
                back.apply(_values(self.translation, at, 2)) - _cross(angular, linear),
                (turn - growth * angular) / square,
            ],
            axis=-1,
        )

    def positions(self, w: npt.ArrayLike) -> FloatArray:
        """Return t(w), (…, 3) [m], for w of shape (…)."""
        return _values(self.translation, np.asarray(w, dtype=np.float64), 0)

    @property
    def degrees(self) -> tuple[int, int]:
        """(σ, τ)."""
        return self.rotation.shape[1] - 1, self.translation.shape[1] - 1

    def part(self, begin: float, end: float) -> CameraPath:
        """Return the part from ``begin`` to ``end`` as a path of its own, s ↦ path(begin + (end − begin)s).

        It stays in the same frame, so it does not start at the identity.
        """
        line = finite_number("begin", begin), finite_number("end", end) - begin
        return CameraPath(_along(self.rotation, *line), _along(self.translation, *line))

    def seen_in(self, frame_T_initial: RigidTransform) -> CameraPath:
        """Return the same path in another frame: w ↦ frame_T_initial · path(w)."""
        x, y, z, w = frame_T_initial.rotation.as_quat()
        turned = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]]) @ self.rotation
        moved = frame_T_initial.rotation.as_matrix() @ self.translation
        moved[:, -1] += frame_T_initial.translation
        return CameraPath(turned, moved)


def _values(coefficients: FloatArray, w: FloatArray, order: int) -> FloatArray:
    """Return the derivative of this order of polynomials (m, n+1) at w (…): (…, m), by Horner."""
    for _ in range(order):
        powers = np.arange(coefficients.shape[1] - 1, 0, -1)
        coefficients = coefficients[:, :-1] * powers
    value = np.zeros((*w.shape, coefficients.shape[0]))
    for column in coefficients.T:
        value = value * w[..., None] + column
    return value


def _along(coefficients: FloatArray, begin: float, step: float) -> FloatArray:
    """Return the powers of p(begin + step·s), highest first, of polynomials (m, n+1), by Horner."""
    found = coefficients[:, :1]
    zero = np.zeros_like(found)
    for column in coefficients.T[1:]:
        found = step * np.hstack([found, zero]) + begin * np.hstack([zero, found])
        found[:, -1] += column
    return found


def _vector_of_product(p: FloatArray, q: FloatArray) -> FloatArray:
    """Return vec(p* ⊗ q) of quaternions (…, 4), (x, y, z, w): p_w q_v − q_w p_v − p_v × q_v."""
    vector: FloatArray = p[..., 3:] * q[..., :3] - q[..., 3:] * p[..., :3] - _cross(p, q)
    return vector


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the products (…, 3) of what the first three numbers of (…, ≥ 3) are: NumPy's own is slow."""
    x, y, z, u, v, w = a[..., 0], a[..., 1], a[..., 2], b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
