"""How near each link comes to what stands around."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from omniservo.geometry.arrays import FloatArray, finite_array
from omniservo.robots.collision.arm_bodies import ArmBodies

FARTHEST = 0.4
"""[m] Gaps that are larger are not distinguished from it."""


def link_gaps(bodies: ArmBodies, joints: npt.ArrayLike) -> dict[str, FloatArray]:
    """Return by link, from the base outwards, its smallest gap (m,) [m] to what stands around.

    Args:
        bodies: the arm and what stands around.
        joints: (m, n) configurations [rad].

    Raises:
        InputError: wrong shape, NaN or infinity.
    """
    postures = finite_array("joints", joints, (None, bodies.arm.dof))
    around = np.array([i for i in range(len(bodies.pairs)) if bodies.is_around(i)], dtype=np.int64)
    links = [bodies.names(i)[0] for i in around.tolist()]
    found = {link: np.full(len(postures), FARTHEST) for link in dict.fromkeys(links)}
    for row, q in enumerate(postures):
        bodies.place(q)
        least = bodies.lower_gaps(around)
        for k in np.argsort(least).tolist():
            gaps = found[links[k]]
            if least[k] < gaps[row]:
                gaps[row] = min(gaps[row], bodies.measure(int(around[k])))
    return found
