"""The camera on the flange as a body: a lens before a housing that reaches back to the flange."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.robots.collision.solid import Solid

_LENS_FRONT, _LENS_BACK, _LENS_RADIUS = 0.005, -0.030, 0.025  # [m]; the pupil lies 5 mm behind the front
_BACK, _HALF_WIDTH, _HALF_HEIGHT = -0.088, 0.032, 0.022  # [m]

CAMERA_HOUSING = (
    Solid(
        "lens",
        "cylinder",
        np.array([_LENS_RADIUS, (_LENS_FRONT - _LENS_BACK) / 2]),
        RigidTransform.from_translation([0.0, 0.0, (_LENS_FRONT + _LENS_BACK) / 2]),
    ),
    Solid.box(
        "housing",
        RigidTransform.from_translation([0.0, 0.0, (_LENS_BACK + _BACK) / 2]),
        np.array([_HALF_WIDTH, _HALF_HEIGHT, (_LENS_BACK - _BACK) / 2]),
    ),
)
"""A small industrial camera with a lens of 50 mm, in the camera frame."""
