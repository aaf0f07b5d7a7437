"""What finding natural features returns."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, owned
from omniservo.perception.image_points import ImagePoints


@with_field_docs
@dataclass(frozen=True, eq=False)
class Features:
    """The natural features of one image, strongest first."""

    points: ImagePoints
    """n places [px] with the covariance of their error; they have no identity"""
    descriptors: npt.NDArray[np.float32]
    """(n, 128) unit vectors: square roots of SIFT histograms that sum to one"""
    scale: FloatArray
    """(n,) [px] standard deviation of the Gaussian at which the feature was found"""
    bearings: FloatArray
    """(n, 3) unit, camera frame"""
    axes: FloatArray
    """(n, 3) [rad] along the feature's orientation, at right angles to its bearing; as long as its scale"""

    def __post_init__(self) -> None:
        for item in fields(self)[2:]:
            object.__setattr__(self, item.name, owned(getattr(self, item.name)))
        descriptors = self.descriptors.copy()
        descriptors.setflags(write=False)
        object.__setattr__(self, "descriptors", descriptors)

    def __len__(self) -> int:
        return len(self.points)
