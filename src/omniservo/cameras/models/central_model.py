"""What every central camera offers, whatever its formula."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy.typing as npt

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.image_mask import ImageMask
from omniservo.cameras.model_error import ModelError
from omniservo.geometry.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@runtime_checkable
class CentralModel(Protocol):
    """A camera whose rays meet in one point: `UnifiedCamera` and every class of this room.

    Inside its domain, `project` and `unproject` are inverse to each other (≤ 10⁻⁹ px). Outside, numbers are
    NaN and ``valid`` is False, from both sides of the border. Models are values, and keys of a dict.
    """

    def __hash__(self) -> int:
        """Return the hash of all numbers."""

    @property
    def width(self) -> int:
        """Of the image [px]; it covers u ∈ [−½, W−½]."""

    @property
    def height(self) -> int:
        """Of the image [px]; it covers v ∈ [−½, H−½]."""

    @property
    def max_angle(self) -> float | None:
        """The largest angle from the axis that the lens sees [rad], where it is stated."""

    @property
    def dead_zone(self) -> DeadZone | None:
        """The disc of the image that shows the camera itself."""

    @property
    def mask(self) -> ImageMask:
        """The polygons of the image that show the camera itself, or nothing."""

    @property
    def deviation_px(self) -> float:
        """How far a true pixel may lie from `project`'s [px]: what conversions or a calibration leave."""

    @property
    def model_error(self) -> ModelError | None:
        """By how much the model is off, alike over regions of the image; None: nothing is stated."""

    @property
    def usable_angle(self) -> float:
        """Largest angle from the axis at which points can be projected [rad]."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person must know, such as a formula that folds inside the image."""

    def project(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return pixels (…, 2) [px] of points (…, 3) [m] in the camera frame, and valid (…)."""

    def unproject(self, pixels: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return bearings (…, 3), unit, that pixels (…, 2) [px] see, and valid (…)."""

    def project_jacobian(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return `project`'s pixels, ∂pixel/∂point (…, 2, 3) [px/m], and valid; NaN where not valid."""

    def unproject_jacobian(self, pixels: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Return `unproject`'s bearings, ∂bearing/∂pixel (…, 3, 2) [1/px], and valid; NaN where not valid."""

    def in_image(self, pixels: npt.ArrayLike) -> BoolArray:
        """Say which pixels (…, 2) [px] lie in the image, outside dead zone and mask."""

    def to_dict(self) -> dict[str, Any]:
        """Return the camera's fields, "model" first; `camera_from_dict` gives an equal camera."""

    def plot_field(self) -> Figure:
        """Return a Matplotlib figure of what the camera sees: its field, limits and pixels a degree."""
