"""Are certified plans of distorted and masked cameras verified? Random lenses, none of them from a set.

Run: ``python -m benchmarks.hard_cameras [--count 1000]``. Principal points anywhere in the image and a little
outside, distortion, dead zones, masks, largest angles; the visibility margin asked for takes part of what the
end poses leave. Every certified plan goes through `verify_plan`.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from time import perf_counter
from typing import Any

import numpy as np
from benchmarks.comparisons.planning.draws import Draws

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import PlanningProblem, plan_path
from omniservo.verification import verify_plan

Fields = dict[str, Any]
POLYGON_REACH = (0.02, 0.12)
"""of a mask's polygons, in image widths"""


def lens(draws: Draws) -> Fields:
    """Return the fields of a camera."""
    width, height = draws.whole(320, 1400), draws.whole(240, 1100)
    xi = (0.0, draws.number(0.3, 1.0), draws.number(1.0, 1.7))[draws.whole(0, 2)]
    focal = (1.0 + xi) * draws.number(0.25, 0.7) * width
    spread = (0.1, 0.1, 0.45, 0.55)[draws.whole(0, 3)]
    fields: Fields = {"model": "unified", "xi": xi, "width": width, "height": height}
    fields |= {"fx": focal, "fy": focal * draws.number(0.98, 1.02)}
    for name, side in (("cx", width), ("cy", height)):
        fields[name] = side * (0.5 + draws.number(-spread, spread))
    if draws.number(0.0, 1.0) < 0.75:
        share = draws.number(0.1, 1.0)
        strengths = (0.15, 0.05, 3e-3, 3e-3)
        fields["distortion"] = [share * draws.number(-k, k) for k in strengths]
    if draws.number(0.0, 1.0) < 0.4:
        fields["max_angle"] = math.radians(draws.number(35.0, 110.0))
    if draws.number(0.0, 1.0) < 0.35:
        center = [draws.number(0.0, width), draws.number(0.0, height)]
        fields["dead_zone"] = {"center": center, "radius": draws.number(0.02, 0.15) * width}
    if draws.number(0.0, 1.0) < 0.4:
        fields["mask"] = [_polygon(draws, width, height) for _ in range(draws.whole(1, 4))]
    return fields


def _polygon(draws: Draws, width: int, height: int) -> list[list[float]]:
    """Return a convex polygon about a point of the image."""
    count = draws.whole(3, 8)
    angles = 2.0 * math.pi * (np.arange(count) + draws.numbers(0.0, 0.6, count)) / count
    middle = np.array([draws.number(0.0, width), draws.number(0.0, height)])
    reach = draws.number(*POLYGON_REACH) * width
    corners: list[list[float]] = (middle + reach * np.column_stack([np.cos(angles), np.sin(angles)])).tolist()
    return corners


def question(draws: Draws) -> PlanningProblem | None:
    """Return a problem whose end poses see all points; None where this lens shows none."""
    fields = lens(draws)
    camera = UnifiedCamera.from_dict(fields)
    count = draws.whole(1, 9)
    near = draws.number(0.05, 1.0)
    middle = np.array([draws.number(0.0, camera.width), draws.number(0.0, camera.height)])
    pixels = middle + near * camera.width * (draws.numbers(0.0, 1.0, 40, 2) - 0.5)
    bearings, valid = camera.unproject(pixels)
    points = bearings[valid & camera.in_image(pixels)][:count]
    if not len(points):
        return None
    points = points * draws.numbers(0.25, 1.0, len(points), 1)
    turn = draws.turn(25.0)
    shift = draws.number(0.01, 0.2) * draws.direction()
    left = min(_least_margin(camera, points), _least_margin(camera, turn.inv().apply(points - shift)))
    if left <= 0.0:
        return None
    goal = {"translation": shift.tolist(), "quaternion": turn.as_quat().tolist()}
    asked = (0.0, draws.number(0.0, 0.9) * left)[draws.whole(0, 1)]
    return PlanningProblem.from_dict(
        {
            "format": "omniservo.problem/1",
            "camera": fields,
            "points": points.tolist(),
            "goal": goal,
            "visibility_margin": asked,
            "obstacles": _balls(draws, points),
            "clearance": 0.02,
        }
    )


def _balls(draws: Draws, points: FloatArray) -> list[Fields]:
    """Return none to two balls between the camera and the points, or beside."""
    balls = []
    for _ in range(draws.whole(0, 2)):
        center = draws.number(0.1, 0.5) * points.mean(axis=0) + 0.1 * draws.direction()
        balls.append({"type": "sphere", "center": center.tolist(), "radius": draws.number(0.005, 0.03)})
    return balls


def _least_margin(camera: UnifiedCamera, points: FloatArray) -> float:
    """Return how far all points stay from the image's border and its dead zone [px]; −1 where one is lost."""
    pixels, valid = camera.project(points)
    if not (valid & camera.in_image(pixels)).all():
        return -1.0
    size = np.array([camera.width, camera.height])
    left = float(np.minimum(pixels + 0.5, size - 0.5 - pixels).min())
    if camera.dead_zone is not None:
        zone = np.array(camera.dead_zone.center)
        left = min(left, float(np.linalg.norm(pixels - zone, axis=1).min()) - camera.dead_zone.radius)
    return left


def judged(index: int) -> tuple[str, tuple[str, ...], float]:
    """Return the planner's status, what the verifier says of a certified plan, and how long that took [s]."""
    try:
        asked = question(Draws("hard cameras", index))
        if asked is None:
            return "not seen at both ends", (), 0.0
        plan = plan_path(asked)
    except InputError:
        return "no legal problem", (), 0.0
    if plan.status != "certified":
        return plan.status, (), 0.0
    before = perf_counter()
    answer = verify_plan(plan)
    return plan.status, (answer.status, *answer.reasons), perf_counter() - before


def main() -> None:
    """Print what became of the problems, and every certified plan that is not verified."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="certified plans")
    parser.add_argument("--first", type=int, default=0, help="number of the first problem")
    given = parser.parse_args()
    statuses: Counter[str] = Counter()
    answers: Counter[str] = Counter()
    longest, index = 0.0, given.first
    while statuses["certified"] < given.count:
        status, answer, seconds = judged(index)
        statuses[status] += 1
        if answer:
            answers[answer[0]] += 1
            longest = max(longest, seconds)
            if answer[0] != "certified":
                print(index, *answer)
        index += 1
    print(f"{index - given.first} problems: {dict(statuses)}")
    print(f"certified plans by the verifier: {dict(answers)}; the longest took {longest:.1f} s")


if __name__ == "__main__":
    main()
