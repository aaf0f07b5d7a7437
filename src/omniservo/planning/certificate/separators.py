"""The separating planes that a certificate carries for its margins about boxes, capsules and meshes."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray, frozen
from omniservo.geometry.polynomial import bernstein_from_power, magnitude
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning.certificate.certificate import Separator
from omniservo.planning.certificate.margins import MARGIN, STATUS
from omniservo.planning.constraints.body_gap import MOTION, RADIUS, REACH
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.motion import point_from_body, seen_from_body
from omniservo.planning.constraints.separation import MOST_PLANES, separate
from omniservo.planning.problem_arrays import Entry


def separators_of(
    constraints: Constraints, entries: list[Entry], table: FloatArray, translation: FloatArray
) -> tuple[Separator, ...]:
    """Return the planes that prove each margin of ``table`` (rows of `margins.path_margins`)."""
    proven = [
        (entry, float(row[MARGIN]))
        for entry, row in zip(entries, table, strict=True)
        if entry.shows_planes and row[STATUS] == PROVEN
    ]
    if not proven:
        return ()
    centre, size = bernstein_from_power(translation), magnitude(translation)
    planes = np.empty((MOST_PLANES + 1, 5))  # a piece more than are halved
    found = []
    for entry, margin in proven:
        body, motions = constraints.bodies[entry.about], constraints.motions
        path, largest = seen_from_body(centre, translation, size, motions, body[MOTION])
        for point in range(len(constraints.points)) if entry.about_point else (None,):
            h = np.empty((3, 0))
            if point is not None:
                h = point_from_body(constraints.points[point], motions, body[MOTION])
            reach = float(body[REACH if point is None else RADIUS]) + margin
            count = separate(path, largest, h, body, constraints.hulls, reach, planes)[2]
            found.append(Separator(entry.name, point, frozen(planes[:count])))
    return tuple(found)
