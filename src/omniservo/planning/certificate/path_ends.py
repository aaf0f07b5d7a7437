"""How far a path's ends are from where they have to be, compiled."""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf


@kernel
def ends_off(
    rotation: FloatArray, translation: FloatArray, quaternion: FloatArray, place: FloatArray
) -> tuple[float, float]:
    """Return how far w = 0 is from the identity and w = 1 from the goal, in the largest coordinate.

    At w = 1 φ/‖φ‖ counts with the sign that is nearer to the goal's: either is the same rotation. NaN where
    φ is 0 at an end.

    Args:
        rotation: φ (4, σ+1), highest power first.
        translation: t (3, τ+1) [m].
        quaternion: of the goal (4,), unit.
        place: of the goal (3,) [m].
    """
    start, goal = 0.0, 0.0
    for i in range(3):
        start = max(start, abs(translation[i, translation.shape[1] - 1]))
        goal = max(goal, abs(_at_end(translation, i) - place[i]))
    last, square, square_there, same = rotation.shape[1] - 1, 0.0, 0.0, 0.0
    for c in range(4):
        there = _at_end(rotation, c)
        square += rotation[c, last] ** 2
        square_there += there**2
        same += there * quaternion[c]
    if square == 0.0 or square_there == 0.0:
        return math.nan, math.nan
    length, length_there = math.sqrt(square), math.copysign(math.sqrt(square_there), same)
    for c in range(4):
        start = max(start, abs(rotation[c, last] / length - (1.0 if c == 3 else 0.0)))
        goal = max(goal, abs(_at_end(rotation, c) / length_there - quaternion[c]))
    return start, goal


@leaf
def _at_end(coefficients: FloatArray, row: int) -> float:
    """Return a row's polynomial at w = 1."""
    total = 0.0
    for k in range(coefficients.shape[1]):
        total += coefficients[row, k]
    return total
