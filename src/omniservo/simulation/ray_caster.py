"""Rays from one point into the world: which geom each one meets first."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from omniservo.geometry.arrays import FloatArray
from omniservo.simulation.model_rays import FARTHEST, with_whole_balls
from omniservo.simulation.world import ARM_GROUP, CAMERA_GROUP, SURROUNDINGS_GROUP, World

MISS = -1
"""Geom number of a ray that meets nothing."""

_GEOM_GROUPS = 6


class RayCaster:
    """Casts rays into a world.

    It owns MjData, so each thread needs its own; the cast releases the interpreter lock.
    """

    def __init__(self, world: World, *, sees_camera: bool, sees_arm: bool = True) -> None:
        """Prepare.

        Args:
            world: what is seen.
            sees_camera: whether the camera's housing is visible; the camera's own rays start in it.
            sees_arm: whether the arm's links are.
        """
        self._groups = np.zeros(_GEOM_GROUPS, dtype=np.uint8)
        self._groups[SURROUNDINGS_GROUP] = 1
        self._groups[ARM_GROUP] = int(sees_arm)
        self._groups[CAMERA_GROUP] = int(sees_camera)
        self._model = _for_rays(world.model, self._groups)
        self._data = mujoco.MjData(self._model)

    def pose_arm(self, q: FloatArray) -> Any:
        """Put the arm into the joints ``q`` (n,) [rad] and return the MjData with its kinematics."""
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        return self._data

    def balls(self) -> tuple[FloatArray, FloatArray]:
        """Return centres (k, 3) and radii (k,) [m] of balls round all that moves with the arm and is seen."""
        moves = (self._groups[self._model.geom_group] > 0) & (self._model.geom_group != SURROUNDINGS_GROUP)
        radii = np.where(
            self._model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE, np.inf, self._model.geom_rbound
        )
        return self._data.geom_xpos[moves], radii[moves]

    def cast(
        self, origin: FloatArray, directions: FloatArray
    ) -> tuple[NDArray[np.int32], FloatArray, FloatArray]:
        """Return what each ray meets first.

        Args:
            origin: (3,) in the world [m].
            directions: (n, 3) unit vectors in the world.

        Returns:
            Geom number (n,), `MISS` for none; distance (n,) [m], negative for none; outward normal (n, 3).
        """
        count = len(directions)
        geoms = np.empty(count, dtype=np.int32)
        distances = np.empty(count)
        normals = np.empty(3 * count)
        mujoco.mj_multiRay(
            self._model,
            self._data,
            origin,
            directions.ravel(),
            self._groups,
            True,  # static geoms too
            -1,  # no body is excluded
            geoms,
            distances,
            normals,
            count,
            FARTHEST,
        )
        return geoms, distances, normals.reshape(count, 3)


def _for_rays(model: Any, groups: NDArray[np.uint8]) -> Any:
    """Return the model for rays that see the groups, in which MuJoCo asks less, and nothing wrong.

    It first asks whether a ray meets a body's ball (`with_whole_balls`), then for each shape whether it lies
    in the angles of the shape's box. What stands around is tested by its boxes alone: all of it counts as one
    body, and bodies without shapes that are seen as none.
    """
    model = with_whole_balls(model)
    seen = groups[model.geom_group] > 0
    around = np.flatnonzero(model.geom_group == SURROUNDINGS_GROUP)
    if len(around) and np.ptp(around) + 1 == len(around):  # a body's shapes follow one another
        holder = model.geom_bodyid[around[0]]
        model.body_geomnum[holder] = len(around)
        model.bvh_aabb[model.body_bvhadr[holder], 3] = FARTHEST
        seen[around[1:]] = False
    passed = np.setdiff1d(np.arange(model.nbody), model.geom_bodyid[seen])
    model.body_geomnum[passed], model.body_bvhadr[passed] = 0, -1
    return model
