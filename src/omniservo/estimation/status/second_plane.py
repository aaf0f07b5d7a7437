"""Whether matches that were left out of a plane agree with another motion of a plane.

A pattern that repeats, of which a part is matched one period off, obeys a second homography, and so does a
flat thing that moves by itself. Which of the two motions the camera made, their numbers do not tell. Another
plane of one rigid scene has a homography, too; then one motion explains both.

That k of r matches left out lie within g px of the best homography by chance is to be expected

    (r − 4) C(r, k) C(k, 4) (π g²/A)^(k − 4)

times, A [px²] the part of the image in which they lie (Moisan and Stival, IJCV 2004).
"""

from __future__ import annotations

import math

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.robust.members import GATE
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, NEARLY_ALL, SIGNIFICANCE, fit_two_views
from omniservo.estimation.status.moving_planes import SAMPLE, SampledMaps, flat_groups
from omniservo.geometry.arrays import BoolArray, IntArray
from omniservo.geometry.false_alarms import false_alarms

LEAST_SHARE = 0.15
"""of the plane's matches; fewer are some small thing"""
GATE_PX = 2.0
"""from a homography, at least; relief is to stay within"""


def second_plane(matches: Matches, inside: BoolArray) -> str:
    """Return the sentence that names a second group; empty where there is none.

    Args:
        matches: all of them.
        inside: (n,) those of the plane that the motion is from.
    """
    count = int(inside.sum())
    least = max(EIGHT_POINTS, math.ceil(LEAST_SHARE * count))
    left = np.flatnonzero(~inside)
    if len(left) < least:
        return ""
    rest, gate = matches.where(~inside), max(GATE_PX, GATE * matches.noise_px)
    part = math.pi * gate**2 / max(float(np.ptp(rest.pixels[:, 2:], axis=0).prod()), 1.0)
    for group, _ in flat_groups(rest, SampledMaps.of(rest), gate, least):
        k, r = int(group.sum()), rest.size
        if false_alarms(r, k, SAMPLE, part, max(r - SAMPLE, 1)) > SIGNIFICANCE:
            continue
        if not _is_one_scene(matches, inside, left[group]):
            return (
                f"{count} of {matches.size} matches agree with one motion before a plane, {k} others with"
                " another: a pattern repeats, or something moves by itself; mask it, or choose nearer views"
            )
    return ""


def _is_one_scene(matches: Matches, inside: BoolArray, group: IntArray) -> bool:
    """Tell whether one motion explains nearly all of the plane and of the group."""
    both = inside.copy()
    both[group] = True
    fit = fit_two_views(matches.where(both), 0, True)
    if fit is None or not fit.minima:
        return False
    explained = np.zeros(matches.size, dtype=np.bool_)
    explained[np.flatnonzero(both)[fit.members]] = True
    return bool(min(explained[inside].mean(), explained[group].mean()) >= NEARLY_ALL)
