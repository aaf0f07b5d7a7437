"""Discs numbered by row and column: each ellipse says how its neighbourhood is stretched."""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.spatial import cKDTree

from omniservo.calibration.boards.discs import Discs
from omniservo.geometry.arrays import FloatArray, IntArray

_NEAREST = 24
_DISTANCE = 0.25  # how far a neighbour may be from where the ellipse's size says, relative
_ALONG = 0.3  # [steps] how far from the next lattice point


def disc_lattices(discs: Discs, ratio: float, *, mirrored: bool) -> list[tuple[IntArray, IntArray]]:
    """Return connected parts of a square lattice, the largest first: numbers (n,), columns and rows (n, 2).

    Args:
        discs: all that were found.
        ratio: distance between neighbours over the radius of a disc, on the board.
        mirrored: whether the camera shows the world reflected.
    """
    if len(discs.pixels) < 4:
        return []
    neighbours = _neighbours(discs, ratio)
    free = np.ones(len(discs.pixels), dtype=bool)
    parts = []
    # a disc of a lattice has four neighbours; one with more may be something else
    for start in np.argsort([abs(len(n) - 4) for n in neighbours], kind="stable"):
        if free[start] and len(neighbours[start]) >= 2:
            numbers, keys = _number_from(int(start), discs.pixels, neighbours)
            free[numbers] = False
            if len(numbers) >= 4:
                parts.append((numbers, keys * np.array([-1 if mirrored else 1, 1])))
    return sorted(parts, key=lambda part: -len(part[0]))


def _neighbours(discs: Discs, ratio: float) -> list[list[int]]:
    """For each disc those that lie as far away, in steps of its own ellipse, as a neighbour must; mutual."""
    near = min(_NEAREST, len(discs.pixels) - 1)
    other = np.asarray(cKDTree(discs.pixels).query(discs.pixels, k=near + 1)[1])[:, 1:]
    offset = discs.pixels[other] - discs.pixels[:, None, :]

    def steps(shape: FloatArray) -> FloatArray:
        square = np.einsum("nki,nkij,nkj->nk", offset, np.linalg.inv(4.0 * shape), offset)
        return np.asarray(np.sqrt(square) / ratio)

    # half way between two discs the stretch is about the mean of both
    mean = 0.5 * (discs.shape[:, None] + discs.shape[other])
    good = np.abs(steps(mean) - 1.0) < _DISTANCE
    return [[int(j) for j in other[i][good[i]]] for i in range(len(other))]


def _number_from(start: int, pixels: FloatArray, neighbours: list[list[int]]) -> tuple[IntArray, IntArray]:
    axes = _axes_at(start, pixels, neighbours)
    if axes is None:
        return np.array([start]), np.zeros((1, 2), dtype=np.int64)
    place = {start: (0, 0)}
    taken = {(0, 0): start}
    frames = {start: axes}
    queue = deque([start])
    while queue:
        i = queue.popleft()
        frame = _fitted_frame(frames[i], i, pixels, neighbours[i])
        for j in neighbours[i]:
            if j in place:
                continue
            steps = np.linalg.solve(frame, pixels[j] - pixels[i])
            whole = np.rint(steps).astype(int)
            key = (place[i][0] + int(whole[0]), place[i][1] + int(whole[1]))
            if np.abs(whole).sum() != 1 or np.abs(steps - whole).max() > _ALONG or key in taken:
                continue
            place[j], taken[key], frames[j] = key, j, frame
            queue.append(j)
    return np.array(list(place)), np.array(list(place.values()), dtype=np.int64)


def _axes_at(i: int, pixels: FloatArray, neighbours: list[list[int]]) -> FloatArray | None:
    """Two neighbours that span the lattice at a disc, right-handed in the image (u right, v down)."""
    offsets = pixels[neighbours[i]] - pixels[i]
    first = offsets[0]
    best, most = None, 0.0
    for second in offsets[1:]:
        sine = (first[0] * second[1] - first[1] * second[0]) / np.linalg.norm(first) / np.linalg.norm(second)
        if abs(sine) > most:
            best, most = (second if sine > 0 else -second), abs(float(sine))
    return None if best is None or most < 0.2 else np.column_stack([first, best])


def _fitted_frame(frame: FloatArray, i: int, pixels: FloatArray, neighbours: list[int]) -> FloatArray:
    """The frame handed on from a neighbour, with each axis taken from the disc's own neighbours on it."""
    fitted = frame.copy()
    offsets = pixels[neighbours] - pixels[i]
    steps = np.linalg.solve(frame, offsets.T).T
    for axis in (0, 1):
        unit = np.eye(2)[axis]
        own = [
            sign * offset
            for sign in (1.0, -1.0)
            for step, offset in zip(steps, offsets, strict=True)
            if np.abs(sign * step - unit).max() <= _ALONG
        ]
        if own:
            fitted[:, axis] = np.mean(own, axis=0)
    return fitted if np.linalg.det(fitted) > 0 else frame
