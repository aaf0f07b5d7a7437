"""Candidates that follow each other along edges of one chequer pattern, numbered by row and column."""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np
from scipy.spatial import cKDTree

from omniservo.calibration.boards.saddle_candidates import Saddles, sample
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray

Lattice = dict[tuple[int, int], int]
"""(column, row) → number of the candidate; columns count to the right, rows downwards, or both turned"""

STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""what half edge 0…3 means in columns and rows; u right, v down makes ascending angles clockwise"""

_NEIGHBOURS = 32
_ALONG = np.linspace(0.2, 0.8, 7)
_ASIDE = 0.12  # of the distance between the two corners: where the two squares of an edge are compared
_TURN = np.deg2rad(28.0)  # an edge's direction at a corner against the line to the next corner
_CONTRAST = 0.2  # of the corners' own contrast, that the whole edge must have


def saddle_lattices(image: ByteArray, saddles: Saddles) -> list[Lattice]:
    """Return the connected parts of at least 4 candidates, the largest first.

    Two candidates are neighbours if a half edge of each points to the other, the edge between them has the
    bright side where both say, and neither has a nearer such neighbour on that half edge.
    """
    if len(saddles) < 4:
        return []
    links = _links(image, saddles)
    lattices = []
    free = np.ones(len(saddles), dtype=bool)
    for start in np.argsort(-(links >= 0).any(axis=2).sum(axis=1), kind="stable"):
        if free[start]:
            lattice = _number_from(int(start), links, free)
            if len(lattice) >= 4:
                lattices.append(lattice)
    return sorted(lattices, key=len, reverse=True)


def _number_from(start: int, links: IntArray, free: BoolArray) -> Lattice:
    """Walk along the links; the turn of each candidate's half edges goes along with the walk."""
    lattice: Lattice = {(0, 0): start}
    place = {start: (0, 0, 0)}  # column, row, turn: half edge a means STEPS[(a − turn) % 4]
    free[start] = False
    queue = deque([start])
    while queue:
        i = queue.popleft()
        column, row, turn = place[i]
        for a in range(4):
            j, b = (int(x) for x in links[i, a])
            if j < 0 or not free[j]:
                continue
            step = (a - turn) % 4
            key = (column + STEPS[step][0], row + STEPS[step][1])
            if key in lattice:
                continue
            lattice[key] = j
            place[j] = (*key, (b - step - 2) % 4)
            free[j] = False
            queue.append(j)
    return lattice


def _links(image: ByteArray, saddles: Saddles) -> IntArray:
    """(n, 4, 2): the neighbour on each half edge and which of its half edges comes back; −1 for none."""
    count = len(saddles)
    near = min(_NEIGHBOURS, count - 1)
    found = cKDTree(saddles.pixels).query(saddles.pixels, k=near + 1)
    distance, other = np.asarray(found[0]), np.asarray(found[1])
    i = np.repeat(np.arange(count), near)
    j, length = other[:, 1:].ravel(), distance[:, 1:].ravel()
    offset = saddles.pixels[j] - saddles.pixels[i]
    heading = np.arctan2(offset[:, 1], offset[:, 0])
    a, off_a = _nearest_edge(saddles.edges[i], heading)
    b, off_b = _nearest_edge(saddles.edges[j], heading + np.pi)
    # going out from i, the sector after half edge a lies clockwise: on the right; at j it comes back
    right_i = saddles.first_is_bright[i] ^ (a % 2 == 1)
    right_j = ~(saddles.first_is_bright[j] ^ (b % 2 == 1))
    good = (off_a < _TURN) & (off_b < _TURN) & (right_i == right_j) & (length > 3.0)
    i, j, a, b, length, right = (x[good] for x in (i, j, a, b, length, right_i))
    good = _edge_is_there(image, saddles, i, j, right)
    i, j, a, b, length = (x[good] for x in (i, j, a, b, length))
    links = np.full((count, 4, 2), -1, dtype=np.int64)
    for k in np.argsort(-length, kind="stable"):  # the nearest is written last
        links[i[k], a[k]] = j[k], b[k]
    back = np.take_along_axis(links[links[..., 0], :, 0], np.maximum(links[..., 1:], 0), axis=2)[..., 0]
    links[back != np.arange(count)[:, None]] = -1
    return links


def _nearest_edge(edges: FloatArray, heading: FloatArray) -> tuple[IntArray, FloatArray]:
    off = np.abs((edges - heading[:, None] + np.pi) % (2 * np.pi) - np.pi)
    best = off.argmin(axis=1)
    return best, np.take_along_axis(off, best[:, None], 1)[:, 0]


def _edge_is_there(
    image: ByteArray, saddles: Saddles, i: IntArray, j: IntArray, right_is_bright: BoolArray
) -> BoolArray:
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.8)
    start, offset = saddles.pixels[i], saddles.pixels[j] - saddles.pixels[i]
    length = np.linalg.norm(offset, axis=1, keepdims=True)
    right = np.stack([-offset[:, 1], offset[:, 0]], 1) / length * np.maximum(_ASIDE * length, 1.2)
    on = start[:, None, :] + _ALONG[:, None] * offset[:, None, :]
    sides = [sample(smooth, *np.moveaxis(on + s * right[:, None, :], 2, 0)) for s in (1.0, -1.0)]
    difference = np.where(right_is_bright[:, None], sides[0] - sides[1], sides[1] - sides[0])
    least = np.minimum(saddles.contrast[i], saddles.contrast[j])
    return np.asarray(difference.min(axis=1, initial=np.inf) > _CONTRAST * least)
