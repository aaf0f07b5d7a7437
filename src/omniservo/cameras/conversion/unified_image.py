"""A camera of any model, for code that is compiled for the unified one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from omniservo.cameras.conversion.convert import to_unified
from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray

_STEP = 0.5
"""[px]"""


@dataclass(frozen=True, eq=False)
class UnifiedImage:
    """The image that a unified camera takes in the place of another: the same bearings at other pixels.

    A pixel p of ``own`` is carried to p' = π(β(p)), with β the bearing that ``own`` gives it and π the
    projection of ``camera``. So what is computed of p' with ``camera`` is computed of ``own``'s bearings,
    however far the two models are apart. The pixels of a unified camera are carried nowhere.
    """

    own: CentralModel
    """whose pixels are given"""
    camera: UnifiedCamera
    """from the same centre, with the model error of ``own``"""

    @property
    def is_own(self) -> bool:
        """Whether both are one camera."""
        return self.own is self.camera

    def carried(self, pixels: FloatArray) -> FloatArray:
        """Return where ``camera`` sees what ``own`` has at pixels (…, 2) [px]; NaN outside a domain."""
        return pixels if self.is_own else self.camera.project(self.own.unproject(pixels)[0])[0]

    def returned(self, pixels: FloatArray) -> FloatArray:
        """Return where ``own`` has what ``camera`` sees at pixels (…, 2) [px]; NaN outside a domain."""
        return pixels if self.is_own else self.own.project(self.camera.unproject(pixels)[0])[0]

    def inside(self, name: str, pixels: FloatArray) -> FloatArray:
        """Return `carried` pixels (n, 2); those of a unified camera as they are, whatever its domain.

        Raises:
            InputError: one has no bearing; ``name`` stands in the message.
        """
        carried, valid = self.kept(pixels, np.ones(len(pixels), dtype=np.bool_))
        if not valid.all():
            j = int(np.argmin(valid))
            raise InputError(
                f"{name}: ({pixels[j, 0]:g}, {pixels[j, 1]:g}) at index {j} is outside the camera's domain"
                f" (at most {math.degrees(self.own.usable_angle):.1f}° from the axis)"
            )
        return carried

    def refuse_parameters(self, name: str) -> None:
        """Raise InputError where the parameters of a unified camera are not the camera's own."""
        if not self.is_own:
            raise InputError(f"{name}: given with a {type(self.own).__name__}; legal: with a UnifiedCamera")

    def scale(self, pixels: FloatArray) -> FloatArray:
        """Return how many pixels of ``camera``, in the geometric mean, are one of ``own`` at (…, 2) (…)."""
        if self.is_own:
            return np.ones(pixels.shape[:-1])
        steps = _STEP * np.eye(2)
        slopes = self.carried(pixels[..., None, :] + steps) - self.carried(pixels[..., None, :] - steps)
        (a, b), (c, d) = np.moveaxis(slopes, (-2, -1), (0, 1))
        scale = np.sqrt(np.abs(a * d - b * c))
        return np.where(np.isfinite(scale), scale, 1.0)

    def kept(self, pixels: FloatArray, valid: BoolArray) -> tuple[FloatArray, BoolArray]:
        """Return `carried` pixels (n, 2), and which of the ``valid`` (n,) lie in both domains."""
        if self.is_own:
            return pixels, valid
        carried = self.carried(pixels)
        outside = np.isnan(carried).any(axis=1) & np.isfinite(pixels).all(axis=1)
        return carried, valid & ~outside


def unified_image(camera: CentralModel) -> UnifiedImage:
    """Return the image of the unified camera nearest to one of any model, in which its field is seen.

    A rim thinner than a hundredth of the image may be lost. Where the nearest loses more of the field, it is
    a parabolic one, which sees all but what is straight behind.
    """
    return UnifiedImage(camera, camera) if isinstance(camera, UnifiedCamera) else _image_of(camera)


@lru_cache(maxsize=32)
def _image_of(camera: CentralModel) -> UnifiedImage:
    try:
        conversion = to_unified(camera)
        nearest = conversion.camera if conversion.residual.lost == 0.0 else _parabolic(camera)
    except InputError:
        nearest = _parabolic(camera)
    return UnifiedImage(camera, _with_error_of(camera, nearest))


def unified_limits(camera: CentralModel) -> UnifiedImage:
    """Return the image of the unified camera whose limits, with its ``deviation_px``, are inside the own."""
    if isinstance(camera, UnifiedCamera):
        return UnifiedImage(camera, camera)
    return UnifiedImage(camera, _with_error_of(camera, to_unified(camera).camera))


def _with_error_of(own: CentralModel, camera: UnifiedCamera) -> UnifiedCamera:
    """Return the camera with the model error of the own one alone, whose bearings all are."""
    error = None if own.model_error is None else own.model_error.to_dict()
    return UnifiedCamera.from_dict({**camera.to_dict(), "model_error": error})


def _parabolic(camera: CentralModel) -> UnifiedCamera:
    """Return the parabolic camera that agrees with another on the axis."""
    (cx, cy), slopes, _ = camera.project_jacobian([0.0, 0.0, 1.0])
    lengths = np.linalg.norm(slopes[:, :2], axis=0)  # not the diagonal, which is 0 where the image is turned
    fx, fy = 2.0 * np.copysign(lengths, np.diag(slopes))
    return UnifiedCamera(fx, fy, cx, cy, 1.0, camera.width, camera.height)
