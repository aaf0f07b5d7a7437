"""Which point of the board is which, from rows and columns that were counted from anywhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

_LEAST_PART = 0.4  # of the board's points
_AHEAD = 2  # points by which the place must beat every other
_TURNS = tuple(
    np.array(m) for m in ([[1, 0], [0, 1]], [[0, 1], [-1, 0]], [[-1, 0], [0, -1]], [[0, -1], [1, 0]])
)
"""by multiples of 90°, without reflection: they keep the board right-handed"""


@dataclass(frozen=True)
class Placing:
    """Where the counted points lie on the board."""

    ids: IntArray
    """(n,) row in the board's lattice, −1 for points that are not on the board"""
    turnable: bool
    """whether another turn of the board fits equally well"""


@dataclass(frozen=True)
class _Place:
    count: int
    keys: IntArray  # (n, 2) in the board's columns and rows
    odd_turn: bool


def place_pattern(
    keys: IntArray, pixels: FloatArray, lattice: IntArray, contrast: FloatArray | None = None
) -> Placing | None:
    """Return the place of counted points on a board, or None where it is not clear.

    It is clear where it holds at least 40% of the board's points, and two more than any other place. Among
    the turns that fit equally, the one with a dark square before the first corner is taken, and then the
    one whose first axis points most to the right in the image.

    Args:
        keys: (n, 2) column and row of each point, counted from anywhere.
        pixels: (n, 2) [px] where they are seen.
        lattice: (m, 2) column and row of the board's points.
        contrast: (n,) positive where the square towards +column and +row is bright; None for other patterns.
    """
    if len(keys) == 0:
        return None
    places, rival = _best_places(keys, lattice)
    most = places[0].count
    if most < _LEAST_PART * len(lattice) or rival > most - _AHEAD:
        return None
    ids = [_ids(place.keys, lattice) for place in places]
    fitting = list(range(len(places)))
    if contrast is not None:
        dark = [k for k in fitting if _dark_first(places[k], contrast, ids[k] >= 0)]
        fitting = dark or fitting
    best = max(fitting, key=lambda k: _points_right(places[k].keys, pixels, ids[k] >= 0))
    return Placing(ids[best], len(fitting) > 1)


def _best_places(keys: IntArray, lattice: IntArray) -> tuple[list[_Place], int]:
    """The fullest place of each turn that reaches the most points, and the count of the best other place."""
    found = []
    for number, turn in enumerate(_TURNS):
        turned = keys @ turn.T
        shifts = (turned[:, None, :] - lattice[None, :, :]).reshape(-1, 2)
        shift, counts = np.unique(shifts, axis=0, return_counts=True)
        order = np.argsort(-counts, kind="stable")
        second = int(counts[order[1]]) if len(order) > 1 else 0
        place = _Place(int(counts[order[0]]), turned - shift[order[0]], number % 2 == 1)
        found.append((place, second))
    most = max(place.count for place, _ in found)
    best = [place for place, _ in found if place.count == most]
    others = [place.count for place, _ in found if place.count < most]
    return best, max([second for place, second in found if place.count == most] + others)


def _ids(keys: IntArray, lattice: IntArray) -> IntArray:
    number = {(int(c), int(r)): k for k, (c, r) in enumerate(lattice)}
    return np.array([number.get((int(c), int(r)), -1) for c, r in keys], dtype=np.int64)


def _dark_first(place: _Place, contrast: FloatArray, inside: BoolArray) -> bool:
    """Whether the square before the first corner, of the colour of the one after it, is dark."""
    parity = 1.0 - 2.0 * (place.keys.sum(axis=1) % 2)
    # after a quarter turn the sector between the axes is one of the other colour
    return float(np.median((contrast * parity)[inside])) * (-1.0 if place.odd_turn else 1.0) < 0.0


def _points_right(keys: IntArray, pixels: FloatArray, inside: BoolArray) -> float:
    x, u = keys[inside, 0], pixels[inside, 0]
    return float((x - x.mean()) @ (u - u.mean()))


def counted_size(keys: IntArray) -> tuple[int, int]:
    """Return how many columns and rows, larger first, have at least half as many points as the fullest."""
    filled = []
    for axis in (0, 1):
        _, counts = np.unique(keys[:, axis], return_counts=True)
        filled.append(int((counts >= 0.5 * counts.max()).sum()))
    return max(filled), min(filled)
