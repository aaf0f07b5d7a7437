"""A flat printed image: a tag, a textured face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.geometry.single_pose import single_pose

_SHORTEST = 1e-4
"""No side is shorter than this [m]."""


@dataclass(frozen=True)
class Panel:
    """A flat printed image. Like a dot it has no body of its own: it cannot be touched.

    Its frame lies in the middle of its face, as a viewer sees it: x right, y down in the image, z into the
    panel. From behind and from the side it is white card.
    """

    name: str
    """unique in its scene"""
    world_T_panel: RigidTransform
    size: FloatArray
    """(2,) width along x, height along y [m]"""
    picture: FloatArray
    """(rows, columns) linear grey in [0, 1]; each entry fills its rectangle of the face evenly"""

    def __post_init__(self) -> None:
        single_pose(f"panel {self.name!r}: world_T_panel", self.world_T_panel)
        size = finite_array(f"panel {self.name!r}: size", self.size, (2,))
        if size.min() < _SHORTEST:
            raise InputError(
                f"panel {self.name!r}: size {size.min():g} m given; at least {_SHORTEST:g} is needed"
            )
        picture = finite_array(f"panel {self.name!r}: picture", self.picture, (None, None))
        if not picture.size or picture.min() < 0.0 or picture.max() > 1.0:
            raise InputError(f"panel {self.name!r}: picture must hold greys between 0 and 1, at least one")
        object.__setattr__(self, "size", frozen(size))
        object.__setattr__(self, "picture", frozen(picture))

    @property
    def corners(self) -> FloatArray:
        """(4, 3) corners in the world [m]: top left, top right, bottom right, bottom left of the image."""
        signs = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])
        corners: FloatArray = self.world_T_panel.apply(signs * [*self.size, 0.0])
        return corners
