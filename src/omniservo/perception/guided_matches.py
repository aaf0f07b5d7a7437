"""More matches of two images: those that one motion of the others leaves room for.

A feature that others elsewhere resemble nearly as much is no clear match among all features of the other
image. Among those near its epipolar circle it often is. It counts where few are clear: cameras turned against
each other, dull rooms.
"""

from __future__ import annotations

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.perception.agreeing_pairs import agreeing_pairs, radians_per_pixel, share_on_one_plane
from omniservo.perception.features import Features
from omniservo.perception.match_features import FeatureMatch, match_near
from omniservo.perception.refine_matches import ImageMatch, refine_matches

LEAST_GUIDES = 16
"""So many pairs that agree on one motion beyond chance tell where others are."""
ENOUGH = 300
"""Of so many matches the camera's error decides how exact the motion is, not their number."""
MOST_ON_ONE_PLANE = 0.9
"""A plane's pairs leave the motion uncertain: others that are found by it would agree with a wrong one."""
BAND_PX = 2.5
"""from the epipolar circles: what the motion of two dozen pairs leaves uncertain of them"""


def guided_matches(
    camera: CentralModel,
    image_initial: ByteArray,
    image_goal: ByteArray,
    initial: Features,
    goal: Features,
    match: FeatureMatch,
) -> ImageMatch:
    """Refine matched features, and what is found beside them near the epipolar circles of those that agree.

    See `refine_matches`, which has the same arguments. Nothing is looked for where `ENOUGH` are found,
    where fewer than `LEAST_GUIDES` agree on one motion beyond chance, or where most of them are of one plane.
    """
    found = refine_matches(camera, image_initial, image_goal, initial, goal, match)
    if found.status != "ok" or len(found) >= ENOUGH:
        return found
    agreement = agreeing_pairs(camera, found.initial.pixels, found.goal.pixels, LEAST_GUIDES)
    if agreement is None:
        return found
    pixels = (found.initial.pixels[agreement.members], found.goal.pixels[agreement.members])
    if share_on_one_plane(camera, *pixels) > MOST_ON_ONE_PLANE:
        return found
    more = match_near(initial, goal, _near_circles(camera, initial, goal, agreement.essential))
    pairs = np.unique(np.concatenate([match.pairs, more]), axis=0)
    if len(pairs) == len(match.pairs):
        return found
    both = FeatureMatch(pairs, "ok", f"{len(pairs)} pairs")
    return refine_matches(camera, image_initial, image_goal, initial, goal, both)


def _near_circles(
    camera: CentralModel, initial: Features, goal: Features, essential: FloatArray
) -> BoolArray:
    """Tell which features (n, m) lie near each other's epipolar circles."""
    x, y = initial.bearings.astype(np.float32), goal.bearings.astype(np.float32)
    matrix = essential.astype(np.float32)
    of_x, of_y = x @ matrix, y @ matrix.T
    apart = np.abs(of_x @ y.T)
    apart /= np.minimum(np.linalg.norm(of_y, axis=1)[None], np.linalg.norm(of_x, axis=1)[:, None]) + 1e-12
    size, size_goal = (radians_per_pixel(camera, f.points.pixels).astype(np.float32) for f in (initial, goal))
    return np.asarray(apart < 0.5 * BAND_PX * (size[:, None] + size_goal[None]))
