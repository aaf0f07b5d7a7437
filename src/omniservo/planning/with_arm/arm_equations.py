"""The normal equations of camera and arm together."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.search.descent import Room, linearise, spread
from omniservo.planning.search.path_family import Family


@kernel
def add_arm(
    family: Family, ell: float, room: Room, chosen: FloatArray, systems: FloatArray, normal: FloatArray
) -> None:
    """Add the systems (m, 6, 7) of the samples ``chosen`` (m,) to the normal equations (nx, nx+1).

    `linearise` was called before: ``room`` knows where the camera is at the samples.
    """
    for k in range(systems.shape[0]):
        s = int(chosen[k])
        spread(family, ell, s, systems[k], room.poses[s], room.turns[s], room.block, normal)


def camera_equations(
    demands: Demands,
    family: Family,
    x: FloatArray,
    targets: FloatArray,
    pull: float,
    room: Room,
) -> tuple[float, FloatArray, FloatArray]:
    """Return cost, smallest g of every group and normal equations (nx, nx+1) of the camera's constraints."""
    least, normal = np.empty_like(targets), np.empty((len(x), len(x) + 1))
    cost = float(linearise(demands, family, x, targets, pull, room, least, normal))
    return cost, least, normal
