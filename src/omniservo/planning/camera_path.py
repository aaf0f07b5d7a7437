"""The planned path of the camera (23)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, overload

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen, frozen_again
from omniservo.geometry.quick_poses import quaternion_of
from omniservo.planning.pose_kernels import powers_along, write_states


@with_field_docs
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

    __setstate__ = frozen_again

    def __repr__(self) -> str:
        way = float(np.linalg.norm(self.translation[:, :-1].sum(axis=1)))
        return f"CameraPath(degrees {self.degrees}, {way:.3g} m from start to end)"

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
        if order not in (0, 1, 2):
            raise InputError(f"order: {order!r} given; legal: 0, 1, 2")
        poses, motions = self.sampled(np.ascontiguousarray(at.reshape(-1)))
        if order == 0:
            # They are rotations but for rounding; SciPy's own way to compose them takes ten times as long.
            return RigidTransform(poses.reshape(*at.shape, 4, 4), normalize=False)
        return motions[:, order - 1].reshape(*at.shape, 6)

    def sampled(self, w: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return poses (m, 4, 4), and twists with their derivatives (m, 2, 6), at w (m,), finite."""
        poses, motions = np.empty((len(w), 4, 4)), np.empty((len(w), 2, 6))
        write_states(*self.powers, w, poses, motions)
        return poses, motions

    @cached_property
    def powers(self) -> tuple[FloatArray, FloatArray]:
        """Both arrays as compiled code takes them: not to be written to."""
        return np.array(self.rotation, order="C"), np.array(self.translation, order="C")

    def positions(self, w: npt.ArrayLike) -> FloatArray:
        """Return t(w), (…, 3) [m], for w of shape (…).

        Raises:
            InputError: w is not finite.
        """
        at = finite_array("w", w, np.shape(w))[..., None]
        value = np.zeros((*at.shape[:-1], 3))
        for column in self.translation.T:
            value = value * at + column
        return value

    @property
    def degrees(self) -> tuple[int, int]:
        """(σ, τ)."""
        return self.rotation.shape[1] - 1, self.translation.shape[1] - 1

    def part(self, begin: float, end: float) -> CameraPath:
        """Return the part from ``begin`` to ``end`` as a path of its own, s ↦ path(begin + (end − begin)s).

        It stays in the same frame, so it does not start at the identity.
        """
        line = finite_number("begin", begin), finite_number("end", end) - begin
        rotation, translation = self.powers
        return CameraPath(powers_along(rotation, *line), powers_along(translation, *line))

    def seen_in(self, frame_T_initial: RigidTransform) -> CameraPath:
        """Return the same path in another frame: w ↦ frame_T_initial · path(w)."""
        x, y, z, w = quaternion_of(frame_T_initial)
        matrix = frame_T_initial.as_matrix()
        turned = np.array([[w, -z, y, x], [z, w, -x, y], [-y, x, w, z], [-x, -y, -z, w]]) @ self.rotation
        moved = matrix[:3, :3] @ self.translation
        moved[:, -1] += matrix[:3, 3]
        return CameraPath(turned, moved)
