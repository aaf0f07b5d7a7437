"""Bodies that are there in another unit: of many metres, or far from all that happens."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.obstacle import Body

if TYPE_CHECKING:
    from omniservo.planning.planning_problem import PlanningProblem

MANY_METRES = 10.0
"""A body larger than this is reported [m]."""

FAR_AWAY = 100.0
"""So is a target or a goal with a coordinate beyond this, from the initial camera [m]."""

_MOMENTS = np.linspace(0.0, 1.0, 17)

Corners = FloatArray
"""(2, 3) least and largest coordinates of a box along the axes [m]"""


def size_notices(problem: PlanningProblem) -> tuple[str, ...]:
    """Return a line for each body larger than 10 m, or farther from points and camera than these are wide.

    And for a target or a goal with a coordinate beyond 100 m.

    Nothing is wrong with such a body, but a file in millimetres that is read as one in metres is one: the
    obstacle that was meant is then not where it is taken to be. All parts of a file are one body. Of
    half-spaces, which have no size, nothing is said.
    """
    scene = np.vstack([np.zeros(3), problem.goal_translation, problem.points])
    scene = np.array([scene.min(axis=0), scene.max(axis=0)])
    bodies: dict[str, Corners] = {}
    advice: dict[str, str] = {}
    for i, obstacle in enumerate(problem.obstacles):
        if isinstance(obstacle, HalfSpace):
            continue
        file = getattr(obstacle, "file", None)
        name, box = f"obstacle {i}" if file is None else file, _moved(_box(obstacle), obstacle.motion)
        advice[name] = "are all lengths in m?" if file is None else "if that file is in mm, state units: mm"
        bodies[name] = _around(bodies[name], box) if name in bodies else box
    told = ((name, words) for name, box in bodies.items() for words in _oddities(box, scene))
    away = (("target", problem.points), ("goal", problem.goal_translation))
    far = ((name, float(np.abs(places).max())) for name, places in away)
    return (
        *(
            f"the {name} has coordinates of {x:.3g} m; are all lengths in m?"
            for name, x in far
            if x > FAR_AWAY
        ),
        *(f"{name} is {words}; {advice[name]}" for name, words in told),
    )


def _oddities(box: Corners, scene: Corners) -> Iterator[str]:
    size, wide = float(np.ptp(box, axis=0).max()), float(np.linalg.norm(np.ptp(scene, axis=0)))
    gap = float(np.linalg.norm(np.maximum(np.maximum(box[0] - scene[1], scene[0] - box[1]), 0.0)))
    if size > MANY_METRES or gap > wide:
        far = f", {gap:.4g} m from the target and the camera, which take {wide:.3g} m" if gap > wide else ""
        yield f"{size:.3g} m large{far}"


def _box(obstacle: Body | Cloud) -> Corners:
    if isinstance(obstacle, Cloud):
        return _grown(obstacle.points, obstacle.radius)
    return _grown(*obstacle.core.outline())


def _grown(points: FloatArray, radius: float) -> Corners:
    return np.array([points.min(axis=0) - radius, points.max(axis=0) + radius])


def _moved(box: Corners, motion: FloatArray | None) -> Corners:
    if motion is None:
        return box
    shifts = np.array([np.polyval(row, _MOMENTS) for row in motion]).T
    return np.array([box[0] + shifts.min(axis=0), box[1] + shifts.max(axis=0)])


def _around(a: Corners, b: Corners) -> Corners:
    return np.array([np.minimum(a[0], b[0]), np.maximum(a[1], b[1])])
