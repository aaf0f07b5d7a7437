"""How fast the target moves through the image along a camera path."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array


def image_speed(
    camera: CentralModel, path: Callable[..., Any], points: npt.ArrayLike, w: npt.ArrayLike
) -> FloatArray:
    """Return max |du/dw| over the points, (m,) [px] per unit of w: times ẇ it is the largest speed [px/s].

    A point c in the camera's frame moves with c′ = −v − ω × c for the camera's twist (v, ω) per unit w, and
    its pixel with u′ = (∂u/∂c) c′. Points that the camera cannot project at a place do not count there.

    Args:
        camera: takes the images.
        path: of w (m,) and an order: 0: initial_T_camera(w); 1: the camera's twist (m, 6) in its own frame.
            `omniservo.planning.CameraPath` is one.
        points: (n, 3) in the initial camera frame [m].
        w: (m,)

    Raises:
        InputError: wrong shapes, or not finite.
    """
    at = finite_array("w", w, (None,))
    target = finite_array("points", points, (None, 3))
    if not len(target):
        raise InputError("points: none given; at least one is needed")
    camera_T_initial = path(at).inv()
    seen = np.stack([camera_T_initial.apply(point) for point in target], axis=1)
    twist = finite_array("path(w, 1)", path(at, 1), (len(at), 6))[:, None]
    moved = -twist[..., :3] - np.cross(twist[..., 3:], seen)
    _, jacobian, valid = camera.project_jacobian(seen)
    speeds = np.linalg.norm(np.einsum("mnij,mnj->mni", jacobian, moved), axis=-1)
    fastest: FloatArray = np.where(valid, speeds, 0.0).max(axis=1)
    return fastest
