"""A camera whose two directions are kernels: arrays of any shape in, values with their validity out."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np
import numpy.typing as npt

from omniservo.cameras.camera_fields import inside_image, rows_of
from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.domain_warnings import domain_warnings
from omniservo.cameras.image_mask import ImageMask
from omniservo.cameras.model_error import ModelError
from omniservo.drawn import drawn
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.short_repr import short_repr

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Kernels = tuple[
    Callable[[FloatArray, FloatArray, FloatArray, BoolArray], None],
    Callable[[FloatArray, FloatArray, FloatArray, BoolArray], None],
]
"""(parameters, points, pixels, valid) and (parameters, pixels, bearings, valid); the last two are written"""


class KernelCamera:
    """What `UnifiedCamera` and the models of `cameras.models` share."""

    kernels: ClassVar[Kernels]
    if TYPE_CHECKING:  # fields of the dataclasses below, or set by them
        width: int
        height: int
        max_angle: float | None
        dead_zone: DeadZone | None
        mask: ImageMask
        deviation_px: float
        model_error: ModelError | None
        usable_angle: float
        parameters: FloatArray

        def project_jacobian(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
            """Return pixels, ∂pixel/∂point, and valid."""

        def unproject_jacobian(self, pixels: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
            """Return bearings, ∂bearing/∂pixel, and valid."""

        def to_dict(self) -> dict[str, Any]:
            """Return the camera's fields."""

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        return str(drawn("value_html", self))

    def plot_field(self) -> Figure:
        """Return a Matplotlib figure of what the camera sees: its field, limits and pixels a degree."""
        return cast("Figure", drawn("field_figure", self))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person must know: where the formula stops being one-to-one inside the image."""
        return domain_warnings(self)

    def project(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Project points in the camera frame.

        Args:
            points: (…, 3) [m]; a NaN or infinite point is not valid.

        Returns:
            pixels (…, 2) [px], NaN where not valid; valid (…): the point is in the domain (the pixel
            may lie outside the image: see `in_image`).

        Raises:
            InputError: not numbers, or the last axis is not 3.
        """
        rows, shape = rows_of("points", points, 3)
        pixels, valid = np.empty((len(rows), 2)), np.empty(len(rows), dtype=np.bool_)
        self.kernels[0](self.parameters, rows, pixels, valid)
        return pixels.reshape(*shape, 2), valid.reshape(shape)

    def unproject(self, pixels: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return the bearings that pixels see.

        Args:
            pixels: (…, 2) [px]; a NaN or infinite pixel is not valid.

        Returns:
            bearings (…, 3), unit vectors in the camera frame, NaN where not valid; valid (…): the pixel is
            in the domain.

        Raises:
            InputError: not numbers, or the last axis is not 2.
        """
        rows, shape = rows_of("pixels", pixels, 2)
        bearings, valid = np.empty((len(rows), 3)), np.empty(len(rows), dtype=np.bool_)
        self.kernels[1](self.parameters, rows, bearings, valid)
        return bearings.reshape(*shape, 3), valid.reshape(shape)

    def in_image(self, pixels: npt.ArrayLike) -> BoolArray:
        """Say which pixels (…, 2) [px] lie in [−½, W−½] × [−½, H−½], outside the dead zone and the mask."""
        return inside_image(self, pixels)
