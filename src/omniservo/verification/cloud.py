"""Point clouds: one line of the certificate for all of their balls.

Planes exclude most points, many at once (`cloud_tree`); the few that come near are judged like spheres.
"""

from collections.abc import Callable
from fractions import Fraction

from omniservo.verification.camera_path import CameraPath, CameraPoint
from omniservo.verification.cloud_tree import Node, TooMuchWork, near, nearest, tree
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding
from omniservo.verification.fields import BEYOND_FLOATS, Vector
from omniservo.verification.motion import Relative, relative
from omniservo.verification.obstacles import Cloud
from omniservo.verification.sphere import far_from_ball, sight_clear_of_ball
from omniservo.verification.work import spend

MOST_TESTS = 400_000
"""Planes that are tried for one line; a ball judged by itself counts as many as take that long."""
_BALL, _SIGHT = 10, 100
_SMALL_STEPS = 40
Ball = Callable[[Relative, Vector, Fraction], Finding]


def cloud_clearance(index: int, cloud: Cloud) -> Constraint[CameraPath]:
    """‖t − m − o‖ ≥ radius + clearance + margin, for every point o."""
    asked, judge = cloud.radius + cloud.clearance, _Judge(cloud, far_from_ball, _BALL)

    def left(path: CameraPath, w: Fraction) -> float:
        return judge.apart(relative(path, cloud.motion, unit=cloud.unit), w) - float(asked)

    def judged(margin: Fraction, path: CameraPath) -> Finding:
        return judge(relative(path, cloud.motion, unit=cloud.unit), asked + margin)

    return Constraint(f"clearance obstacle {index}", "m", lambda m: lambda path: judged(m, path), left)


def cloud_occlusion(index: int, cloud: Cloud) -> Constraint[CameraPoint]:
    """Every line of sight keeps radius + margin from every point o."""
    judge = _Judge(cloud, sight_clear_of_ball, _SIGHT)

    def seen(point: CameraPoint) -> Relative:
        return relative(point.path, cloud.motion, unit=cloud.unit, target=point.point)

    def left(point: CameraPoint, w: Fraction) -> float:
        return judge.apart(seen(point), w) - float(cloud.radius)

    def judged(margin: Fraction, point: CameraPoint) -> Finding:
        return judge(seen(point), cloud.radius + margin)

    return Constraint(f"occlusion obstacle {index}", "m", lambda m: lambda point: judged(m, point), left)


class _Judge:
    """Judges all balls of a cloud, and counts the work."""

    def __init__(self, cloud: Cloud, ball: Ball, cost: int) -> None:
        self._cloud, self._ball, self._cost = cloud, ball, cost
        self._left = MOST_TESTS

    def __call__(self, seen: Relative, distance: Fraction) -> Finding:
        """Judge the balls that planes do not exclude."""
        if distance <= 0:
            return HOLDS
        doubt, done = HOLDS, set()
        ends = [end for end in (seen.camera, seen.target) if end]
        try:
            reach = distance * seen.scale
            for i in near(_tree(self._cloud, seen.scale), ends, reach, seen.scale, self._count):
                if i in done:
                    continue
                done.add(i)
                self._count(self._cost)
                spend(_SMALL_STEPS * self._cost)
                finding = self._ball(seen, self._cloud.points[i], distance)
                if finding.verdict == "violated":
                    return finding
                doubt = doubt if finding is HOLDS else finding
        except TooMuchWork:
            note = f"{len(self._cloud.points)} points, more work than this verifier takes on"
            return Finding("undecided", None, note)
        except BEYOND_FLOATS:
            return Finding("undecided", None, "numbers too large for the floating point of the hints")
        return doubt

    def apart(self, seen: Relative, w: Fraction) -> float:
        """Return the smallest distance of a point at w [m], in floating point, for messages only."""
        start = [float(x) for x in seen.camera_at(w)]
        end = [float(x) for x in seen.target_at(w)] if seen.target else start
        return nearest(_tree(self._cloud, seen.scale), start, end)

    def _count(self, tests: int = 1) -> None:
        self._left -= tests
        if self._left < 0:
            raise TooMuchWork


def _tree(cloud: Cloud, scale: int) -> Node:
    """Return the cloud's tree, built once: clearance and lines of sight have the same scale."""
    if scale not in cloud.trees:
        points = [tuple(x.numerator * (scale // x.denominator) for x in p) for p in cloud.points]
        cloud.trees[scale] = tree(points, list(range(len(points))), scale)
    return cloud.trees[scale]
