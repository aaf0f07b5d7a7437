"""Image features and their interaction matrices: bearings everywhere, virtual-plane points for Z > 0."""

from dataclasses import dataclass
from typing import Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array
from omniservo.servoing.interaction import BEARING, VIRTUAL_PLANE, write_features, write_interaction

FeatureName = Literal["bearing", "virtual-plane"]


class Feature(Protocol):
    """One kind of image feature: s as a function of the direction to a point, and ∂s/∂(camera twist)."""

    @property
    def kind(self) -> int:
        """The number by which kernels know the feature (`omniservo.servoing.interaction`)."""
        ...

    @property
    def width(self) -> int:
        """k, the coordinates of one feature."""
        ...

    def value(self, bearings: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return s (n, k) of directions (n, 3), and where it exists (n,)."""
        ...

    def interaction(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return L (n, k, 6) of points in the camera frame (n, 3) [m], and where it exists (n,)."""
        ...


@with_field_docs
@dataclass(frozen=True)
class BearingFeatures:
    """s = b = c/‖c‖ ∈ R³, for every c ≠ 0, also past 90° from the optical axis."""

    kind: int = BEARING
    """the kernels' number"""
    width: int = 3
    """coordinates of one feature"""

    def value(self, bearings: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return b (n, 3) of directions (n, 3) of any length but zero, and where it exists (n,)."""
        return _value(self, bearings)

    def interaction(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return L = [−(1/‖c‖)(I − b bᵀ)   [b]×], (n, 3, 6), and where it exists (n,).

        ds/dt = L · (linear [m/s], angular [rad/s]) for points c (n, 3) [m] that stand still, twist of the
        camera in the camera frame.
        """
        return _interaction(self, points)


@with_field_docs
@dataclass(frozen=True)
class VirtualPlaneFeatures:
    """s = (X/Z, Y/Z), the paper's points on the virtual plane (3): only where Z > 0."""

    kind: int = VIRTUAL_PLANE
    """the kernels' number"""
    width: int = 2
    """coordinates of one feature"""

    def value(self, bearings: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return (X/Z, Y/Z), (n, 2), of directions (n, 3), and where Z > 1e-9 ‖c‖ (n,); NaN elsewhere."""
        return _value(self, bearings)

    def interaction(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return the classical 2×6 block at depth Z of points c (n, 3) [m], (n, 2, 6), and where Z > 0 (n,).

        [[−1/Z, 0, x/Z, xy, −(1 + x²), y], [0, −1/Z, y/Z, 1 + y², −xy, −x]] (Chaumette and Hutchinson 2006).
        """
        return _interaction(self, points)


def feature_named(name: FeatureName) -> Feature:
    """Return the feature called ``name``.

    Raises:
        InputError: no such feature.
    """
    if name == "bearing":
        return BearingFeatures()
    if name == "virtual-plane":
        return VirtualPlaneFeatures()
    raise InputError(f"feature: {name!r} given; legal: {', '.join(get_args(FeatureName))}")


def features_of(feature: Feature, directions: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return s (n, k) of directions (n, 3) that are not checked, and where it exists (n,); else 0.

    It exists in no direction that is not finite.
    """
    features = np.empty((len(directions), 3))
    valid = np.empty(len(directions), dtype=np.bool_)
    write_features(feature.kind, np.ascontiguousarray(directions), features, valid)
    return features[:, : feature.width], valid


def interaction_of(feature: Feature, points: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return L (n, k, 6) of points (n, 3) that are not checked, and where it exists (n,); else 0."""
    rows = np.empty((len(points), 3, 6))
    valid = np.empty(len(points), dtype=np.bool_)
    write_interaction(feature.kind, np.ascontiguousarray(points), rows, valid)
    return rows[:, : feature.width], valid


def _value(feature: Feature, bearings: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
    features, valid = features_of(feature, finite_array("bearings", bearings, (None, 3)))
    features[~valid] = np.nan
    return features, valid


def _interaction(feature: Feature, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
    rows, valid = interaction_of(feature, finite_array("points", points, (None, 3)))
    rows[~valid] = np.nan
    return rows, valid
