"""Rays from one point into any MuJoCo model: which geom each one meets first."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from copy import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omniservo.geometry.arrays import FloatArray, IntArray

FARTHEST = 1e6
"""[m]"""

_THREADS = 2
_SHOWN = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
"""geom groups that MuJoCo's own viewers show"""

_ROOM = 1.0 + 1e-9
"""A ball's radius is rounded; what lies on it is met."""


class ModelRays:
    """Casts rays into a model, in two threads; what its data says moves, and is only read."""

    def __init__(self, model: Any) -> None:
        """Prepare for a model: shapes of the groups 0 to 2 are met, as MuJoCo's viewers show them."""
        self._model = with_whole_balls(model)
        self._pool = ThreadPoolExecutor(_THREADS, thread_name_prefix="rays")

    def cast(
        self, data: Any, origin: FloatArray, directions: FloatArray
    ) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return geoms (n,), −1 for none, distances (n,) [m], negative for none, outward normals (n, 3).

        Args:
            data: with positions computed (``mj_forward``).
            origin: (3,) [m] in the world.
            directions: (n, 3) unit vectors in the world.
        """
        parts = list(
            self._pool.map(
                lambda part: _cast(self._model, data, origin, part), np.array_split(directions, _THREADS)
            )
        )
        geoms, distances, normals = (np.concatenate(kind) for kind in zip(*parts, strict=True))
        return geoms.astype(np.int64), distances, normals


def _cast(
    model: Any, data: Any, origin: FloatArray, directions: FloatArray
) -> tuple[NDArray[np.int32], FloatArray, FloatArray]:
    count = len(directions)
    geoms, distances, normals = np.empty(count, dtype=np.int32), np.empty(count), np.empty(3 * count)
    if count:
        mujoco.mj_multiRay(
            model, data, origin, np.ascontiguousarray(directions).ravel(), _SHOWN,
            True,  # static geoms too
            -1,  # no body is excluded
            geoms, distances, normals, count, FARTHEST,
        )  # fmt: skip
    return geoms, distances, normals.reshape(count, 3)


def with_whole_balls(model: Any) -> Any:
    """Return the model for rays, in which the ball of each body holds all of the body's shapes.

    Rays together are first tried on a body's ball (MuJoCo 3.17). Its own holds the shapes that are touched,
    and is misplaced where the body's inertia is stated off its origin with skew axes: what sticks out of it
    would not be met. Here it lies round the body's centre of mass, where MuJoCo puts it, and holds all.
    """
    model = copy(model)
    reach = np.linalg.norm(model.geom_pos - model.body_ipos[model.geom_bodyid], axis=1) + model.geom_rbound
    reach[model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE] = FARTHEST
    for first, geoms, tree in zip(model.body_geomadr, model.body_geomnum, model.body_bvhadr, strict=True):
        if tree >= 0:
            model.bvh_aabb[tree] = [0.0, 0.0, 0.0, _ROOM * reach[first : first + geoms].max(), 0.0, 0.0]
    return model
