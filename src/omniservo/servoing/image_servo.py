"""Classical image-based servoing: no plan, the goal image is the reference from the start."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt

from omniservo.cameras.models import CentralModel
from omniservo.errors import FeatureLoss, InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, finite_number
from omniservo.servoing.control_law import camera_twist, limited_twist
from omniservo.servoing.features import FeatureName, feature_named

MatrixName = Literal["current", "desired", "mean"]


@with_field_docs
@dataclass(frozen=True)
class ImageServoOptions:
    """How the classical law is run."""

    feature: FeatureName = "virtual-plane"
    """"virtual-plane" is the classical law; "bearing" also sees points past 90°."""
    matrix: MatrixName = "current"
    """Which interaction matrix is inverted: L(s), L(s*), or their mean (Malis 2004). They take different
    paths, so a comparison must name it."""
    gain: float = 1.0
    """λ [1/s]"""
    least_features: int = 4
    """fewer usable points stop the servo"""
    max_linear_speed: float = 1.0
    """The whole twist is scaled down to this [m/s]."""
    max_angular_speed: float = 3.0
    """The whole twist is scaled down to this [rad/s]."""

    def __post_init__(self) -> None:
        feature_named(self.feature)
        if self.matrix not in get_args(MatrixName):
            raise InputError(f"matrix: {self.matrix!r} given; legal: {', '.join(get_args(MatrixName))}")
        finite_number("gain", self.gain, above=0.0)
        finite_number("least_features", self.least_features, minimum=4)
        finite_number("max_linear_speed", self.max_linear_speed, above=0.0)
        finite_number("max_angular_speed", self.max_angular_speed, above=0.0)


@with_field_docs
@dataclass(frozen=True)
class ImageServoReport:
    """What the last step saw."""

    error_px: float
    """rms distance of the used points to the goal image [px]"""
    valid_count: int
    """points used"""
    limited: bool
    """the twist was scaled down to a speed limit"""


class ImageServo:
    """v = −λ L⁺ (s − s*), s* the features of the goal image.

    Args:
        camera: the camera that takes and took the images.
        goal_pixels: (n, 2) [px], the points in the goal image.
        goal_distances: (n,) ‖c‖ of the points at the goal [m]; needed by matrix "desired" and "mean".
        options: see ImageServoOptions.

    Raises:
        InputError: wrong shapes, a goal pixel that the camera cannot unproject or that the feature cannot
            express, distances that are missing or not positive.
    """

    def __init__(
        self,
        camera: CentralModel,
        goal_pixels: npt.ArrayLike,
        *,
        goal_distances: npt.ArrayLike | None = None,
        options: ImageServoOptions | None = None,
    ) -> None:
        self.options = options or ImageServoOptions()
        """as given"""
        self.report: ImageServoReport | None = None
        """of the last step; None before the first"""
        self._camera = camera
        self._feature = feature_named(self.options.feature)
        self._goal_pixels = finite_array("goal_pixels", goal_pixels, (None, 2))
        bearings, seen = camera.unproject(self._goal_pixels)
        self._goal, exists = self._feature.value(np.where(seen[:, None], bearings, 0.0))
        if not exists.all():
            j = int(np.argmin(exists))
            raise InputError(
                f"goal_pixels: row {j}, {self._goal_pixels[j]}, has no {self.options.feature} feature"
            )
        if self.options.matrix != "current":
            distances = _distances("goal_distances", goal_distances, len(self._goal))
            self._goal_interaction = self._feature.interaction(bearings * distances[:, None])[0]

    def step(
        self,
        pixels: npt.ArrayLike,
        distances: npt.ArrayLike | None = None,
        valid: npt.ArrayLike | None = None,
    ) -> FloatArray:
        """Return the camera twist (6,), (linear [m/s], angular [rad/s]) in the camera frame.

        Args:
            pixels: (n, 2) [px], in the order of goal_pixels; lost rows may hold anything.
            distances: (n,) ‖c‖ of the points now [m]; needed by matrix "current" and "mean".
            valid: (n,) bool, False for lost points; None: all are there.

        Raises:
            FeatureLoss: fewer than ``least_features`` points are usable.
            SingularInteraction: the usable points do not determine a twist.
            InputError: wrong shapes; a number that is not finite, or a distance not positive, in a valid row.
        """
        use, seen = self._usable(pixels, valid)
        bearings, _ = self._camera.unproject(seen)
        features, _ = self._feature.value(np.where(use[:, None], bearings, [0.0, 0.0, 1.0]))
        count = int(use.sum())
        if count < self.options.least_features:
            raise FeatureLoss(f"{count} usable points; at least {self.options.least_features} are needed")
        interaction = self._interaction(bearings[use], use, distances)
        twist = camera_twist((features - self._goal)[use], interaction, None, self.options.gain)
        twist, factor = limited_twist(twist, self.options.max_linear_speed, self.options.max_angular_speed)
        gaps = (seen - self._goal_pixels)[use]
        self.report = ImageServoReport(float(np.sqrt((gaps**2).sum() / count)), count, factor < 1.0)
        return twist

    def _usable(self, pixels: npt.ArrayLike, valid: npt.ArrayLike | None) -> tuple[BoolArray, FloatArray]:
        """Return which points have a feature now (n,), and the pixels with lost rows replaced (n, 2)."""
        count = len(self._goal)
        use = np.ones(count, dtype=np.bool_) if valid is None else np.array(valid)
        if use.shape != (count,) or use.dtype != np.bool_:
            raise InputError(f"valid: {use.dtype} {use.shape} given; bool ({count},) is needed")
        given = np.asarray(pixels, dtype=np.float64)
        if given.shape != (count, 2):
            raise InputError(f"pixels: shape {given.shape} given; ({count}, 2) is needed")
        seen = finite_array(
            "pixels (valid rows)", np.where(use[:, None], given, self._goal_pixels), (count, 2)
        )
        bearings, inside = self._camera.unproject(seen)
        _, exists = self._feature.value(np.where(inside[:, None], bearings, 0.0))
        return use & exists, seen

    def _interaction(
        self, bearings: FloatArray, use: BoolArray, distances: npt.ArrayLike | None
    ) -> FloatArray:
        """Return the chosen interaction blocks of the used points."""
        if self.options.matrix == "desired":
            return self._goal_interaction[use]
        now = _distances("distances", distances, len(use), use)
        current = self._feature.interaction(bearings * now[:, None])[0]
        if self.options.matrix == "current":
            return current
        mean: FloatArray = 0.5 * (current + self._goal_interaction[use])
        return mean


def _distances(
    name: str, value: npt.ArrayLike | None, count: int, use: BoolArray | None = None
) -> FloatArray:
    """Return the distances of the used rows, checked."""
    if value is None:
        raise InputError(f"{name}: missing; ({count},) distances [m] are needed by this interaction matrix")
    given = np.asarray(value, dtype=np.float64)
    if given.shape != (count,):
        raise InputError(f"{name}: shape {given.shape} given; ({count},) is needed")
    used = finite_array(name, given if use is None else given[use], (None,))
    if (used <= 0.0).any():
        raise InputError(f"{name}: {used.min():g} given; legal: > 0")
    return used
