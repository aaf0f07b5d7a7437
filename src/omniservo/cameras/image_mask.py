"""Where the image shows the camera itself, or nothing: convex polygons in pixels."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import FloatArray, finite_array

Corner = tuple[float, float]
ImageMask = tuple[tuple[Corner, ...], ...]
"""The corners (u, v) [px] of each polygon, in either order round it."""

MOST_POLYGONS = 64
MOST_CORNERS = 64

_FARTHEST = 1e6
"""[px]; with the next it keeps the rounding of an edge's line far below 1e-7 px"""

_SHORTEST = 1e-6
"""An edge is at least so long [px]."""


def mask_from(value: Any) -> ImageMask:
    """Return the mask that ``value`` spells: at most 64 strictly convex polygons of 3 to 64 corners.

    Raises:
        InputError: not such polygons; the message names the polygon and what is wrong with it.
    """
    polygons = _listed("mask", value, "a list of polygons", 0, MOST_POLYGONS)
    return tuple(_polygon(f"mask[{i}]", polygon) for i, polygon in enumerate(polygons))


def outward_edges(polygon: Sequence[Corner], margin_px: float = 0.0) -> FloatArray:
    """Return the lines (k, 3) of a convex polygon's edges, moved outward: unit n and b [px].

    A pixel p is outside, or on the border, where n·p ≥ b for at least one of them.
    """
    corners = np.array(polygon)
    along = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(along[:, 0], along[:, 1])[:, None]
    spread = corners - corners[0]
    area = spread[:, 0] @ along[:, 1] - spread[:, 1] @ along[:, 0]
    normals = normals if area > 0.0 else -normals  # a single corner's turn may be but rounding
    return np.column_stack([normals, np.einsum("ij,ij->i", normals, corners) + margin_px])


def distance_beyond(mask: ImageMask, pixels: FloatArray) -> FloatArray:
    """Return how far pixels (…, 2) lie beyond every polygon (…) [px].

    So far all edges can move outward with the pixel still outside. Negative in a polygon; ∞ without any.
    """
    least = np.full(pixels.shape[:-1], np.inf)
    for polygon in mask:
        most = np.full(pixels.shape[:-1], -np.inf)
        for a, b, offset in outward_edges(polygon):
            most = np.maximum(most, a * pixels[..., 0] + b * pixels[..., 1] - offset)
        least = np.minimum(least, most)
    return least


def _listed(name: str, value: Any, what: str, fewest: int, most: int) -> Any:
    if not isinstance(value, list | tuple | np.ndarray) or getattr(value, "ndim", 1) == 0:
        raise InputError(f"{name}: {spelled(value)} given; legal: {what}")
    if not fewest <= len(value) <= most:
        raise InputError(f"{name}: {len(value)} given; legal: {what}, {fewest} to {most}")
    return value


def _polygon(name: str, value: Any) -> tuple[Corner, ...]:
    corners = finite_array(name, _listed(name, value, "corners [u, v]", 3, MOST_CORNERS), (None, 2))
    if np.abs(corners).max() > _FARTHEST:
        raise InputError(f"{name}: {np.abs(corners).max():g} given; legal: -1e6 to 1e6 px")
    lengths = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    if lengths.min() < _SHORTEST:
        k = int(lengths.argmin())
        raise InputError(
            f"{name}: corners {k} and {(k + 1) % len(corners)} are {lengths[k]:g} px apart; "
            f"legal: at least {_SHORTEST:g}"
        )
    _check_convex(name, [(Fraction(u), Fraction(v)) for u, v in corners.tolist()])
    return tuple((u, v) for u, v in corners.tolist())


def _check_convex(name: str, corners: list[tuple[Fraction, Fraction]]) -> None:
    """Refuse a polygon that does not turn the same way, once round, at every corner; exact."""
    count = len(corners)
    along = [
        (corners[(i + 1) % count][0] - u, corners[(i + 1) % count][1] - v) for i, (u, v) in enumerate(corners)
    ]
    turns = [along[i - 1][0] * along[i][1] - along[i - 1][1] * along[i][0] for i in range(count)]
    straight = [i for i, turn in enumerate(turns) if turn == 0]
    if straight:
        raise InputError(f"{name}: corner {straight[0]} lies on a line with its neighbours; leave it out")
    bent = [i for i, turn in enumerate(turns) if (turn > 0) != (turns[0] > 0)]
    if bent:
        raise InputError(f"{name}: not convex: it turns the other way at corner {bent[0]}; split it")
    upward = [v > 0 or (v == 0 and u > 0) for u, v in along]
    if sum(upward[i - 1] != upward[i] for i in range(count)) != 2:
        raise InputError(f"{name}: not convex: it runs round more than once; split it")
