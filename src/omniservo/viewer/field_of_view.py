"""What a camera sees, as a surface about its centre: a cone for a narrow lens, a cap for a wide one."""

from __future__ import annotations

import math

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import FloatArray, IntArray

_TURNS = 72
"""directions round the axis"""

_ANGLES = 500
"""angles from the axis at which it is seen whether the image shows them"""

_RINGS = 5
"""of the surface, from its inner border to its outer"""


def field_surface(camera: CentralModel, radius: float) -> tuple[FloatArray, IntArray]:
    """Return the part of a sphere that the image shows, and its sides: vertices (n, 3) [m], faces (m, 3).

    In the camera frame. In each direction round the axis it goes from the first angle that the image shows to
    the last: a dead zone in the middle is left out, a mask is not.
    """
    inner, outer = _seen_angles(camera)
    share = np.linspace(0.0, 1.0, _RINGS)[:, None]
    surface = _directions(inner + share * (outer - inner))
    vertices = radius * np.vstack([surface.reshape(-1, 3), np.zeros((1, 3))])
    ring = np.arange(_TURNS)
    following = (ring + 1) % _TURNS
    faces = []
    for k in range(_RINGS - 1):
        here, there = k * _TURNS, (k + 1) * _TURNS
        faces.append(np.stack([here + ring, there + ring, there + following], axis=-1))
        faces.append(np.stack([here + ring, there + following, here + following], axis=-1))
    rim, centre = (_RINGS - 1) * _TURNS, _RINGS * _TURNS
    faces.append(np.stack([rim + ring, np.full(_TURNS, centre), rim + following], axis=-1))
    return vertices, np.concatenate(faces)


def field_outline(camera: CentralModel, radius: float) -> FloatArray:
    """Return the outer border of `field_surface` as segments (k, 2, 3) [m]."""
    rim = radius * _directions(_seen_angles(camera)[1])
    return np.stack([rim, np.roll(rim, -1, axis=0)], axis=1)


def _seen_angles(camera: CentralModel) -> tuple[FloatArray, FloatArray]:
    """Return the first and the last angle from the axis (turns,) that the image shows [rad]; 0 of none."""
    angles = np.linspace(0.0, camera.usable_angle * (1.0 - 1e-9), _ANGLES)
    pixels, valid = camera.project(_directions(np.repeat(angles[:, None], _TURNS, axis=1)))
    seen = valid & camera.in_image(np.where(valid[..., None], pixels, -1e6))
    first, last = seen.argmax(axis=0), _ANGLES - 1 - seen[::-1].argmax(axis=0)
    some = seen.any(axis=0)
    return np.where(some, angles[first], 0.0), np.where(some, angles[last], 0.0)


def _directions(angles: FloatArray) -> FloatArray:
    """Return unit vectors (…, turns, 3) at angles (…, turns) from the axis [rad], evenly round it."""
    turns = 2.0 * math.pi * np.arange(_TURNS) / _TURNS
    across = np.sin(angles)
    return np.stack([across * np.cos(turns), across * np.sin(turns), np.cos(angles)], axis=-1)
