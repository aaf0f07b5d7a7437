"""What a camera's pixels look at: the first surface along each ray."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.simulation.ray_caster import RayCaster
from omniservo.simulation.true_lens import TrueLens
from omniservo.simulation.world import World


def points_under(world: World, joints: FloatArray, pixels: FloatArray) -> FloatArray:
    """Return the points (n, 3) [m], in the world, that the camera on the flange shows at ``pixels`` (n, 2).

    NaN where a pixel lies outside the camera's domain or its ray meets nothing.

    Args:
        world: what is seen.
        joints: (n,) of the arm [rad].
        pixels: (n, 2) [px].
    """
    caster = RayCaster(world, sees_camera=False)
    pose = world.world_T_camera(caster.pose_arm(joints))
    bearings, valid = TrueLens(world.scene).unproject(pixels)
    directions = pose.rotation.apply(np.where(valid[:, None], bearings, [0.0, 0.0, 1.0]))
    origin = np.array(pose.translation)
    _, distances, _ = caster.cast(origin, np.ascontiguousarray(directions))
    met = valid & (distances >= 0.0)
    return np.asarray(np.where(met[:, None], origin + distances[:, None] * directions, np.nan))
