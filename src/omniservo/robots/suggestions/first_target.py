"""What the documentation's first task for an own arm looks at, and where its camera goes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import frozen

FIRST_TARGET = frozen(
    np.array([[x, y, 0.255] for x in np.linspace(-0.08, 0.08, 5) for y in np.linspace(-0.08, 0.08, 5)])
)
"""(25, 3) over all of its target, in the initial camera frame [m]"""

FIRST_GOALS = tuple(
    RigidTransform.from_components(
        [0.06 * x, 0.06 * y, 0.05], Rotation.from_rotvec([0.14 * y, -0.14 * x, turn])
    )
    for x, y, turn in ((1, 1, 0.18), (1, -1, 0.18), (-1, 1, -0.18), (-1, -1, -0.18))
)
"""initial_T_goal: the task's goal is nearer than the first, and the others are on its other sides"""
