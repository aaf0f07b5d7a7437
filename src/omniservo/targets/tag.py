"""A square tag on a target: which one it is, how large, and where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, owned
from omniservo.geometry.single_pose import single_pose
from omniservo.tag_dictionaries import dictionary_name, dictionary_size

_CORNERS = np.array([[-0.5, -0.5, 0.0], [0.5, -0.5, 0.0], [0.5, 0.5, 0.0], [-0.5, 0.5, 0.0]])


@with_field_docs
@dataclass(frozen=True, eq=False)
class Tag:
    """One printed tag. Its frame: origin in the middle, x right and y down in the print, z **into** the face.

    So the camera that looks at the upright tag squarely has the tag's axes. The corners, in the order of
    cv2.aruco, are top left, top right, bottom right, bottom left of the upright print:
    (∓e/2, ∓e/2, 0) with edge e, the outer edge of the dark border, or, of an AprilTag 3 family, where its
    black ring and the white one within meet.
    """

    dictionary: str
    """name of the dictionary: tag36h11, 4x4_50, tagStandard41h12, …; OpenCV's DICT_4X4_50 becomes such"""
    id: int
    """number in the dictionary"""
    edge: float
    """side of the square with these corners [m]"""
    target_T_tag: RigidTransform
    """where it is on the target"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "dictionary", dictionary_name(self.dictionary))
        whole = isinstance(self.id, int | np.integer) and not isinstance(self.id, bool)
        size = dictionary_size(self.dictionary)
        if not whole or not 0 <= self.id < size:
            raise InputError(f"id: {spelled(self.id)} given; legal: whole numbers from 0 to {size - 1}")
        object.__setattr__(self, "id", int(self.id))
        object.__setattr__(self, "edge", finite_number("edge", self.edge, above=0.0))
        single_pose("target_T_tag", self.target_T_tag)
        finite_array("corners", self.corners, (4, 3))

    @property
    def corners(self) -> FloatArray:
        """(4, 3) [m] in the target frame."""
        return owned(self.target_T_tag.apply(self.edge * _CORNERS))
