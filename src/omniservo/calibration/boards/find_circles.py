"""The centres of a grid of dark discs, and what a lens makes of them."""

from __future__ import annotations

import numpy as np

from omniservo.calibration.boards.board import CircleGrid
from omniservo.calibration.boards.board_pose import board_pose
from omniservo.calibration.boards.board_view import BoardView
from omniservo.calibration.boards.disc_lattices import disc_lattices
from omniservo.calibration.boards.discs import find_discs
from omniservo.calibration.boards.place_pattern import counted_size, place_pattern
from omniservo.cameras.models.central_model import CentralModel
from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray

_TRIED = 4
_OUTLINE = 72  # points of a disc's rim
_ROUNDS = 4


def find_circles(
    image: ByteArray, board: CircleGrid, camera: CentralModel | None = None, *, mirrored: bool = False
) -> BoardView:
    """Find the discs' centres.

    The centroid of a disc's image is not the image of its centre. With a camera the difference is computed,
    from the board's pose, and taken off; without one the pixels are centroids.

    Args:
        image: (height, width) grey values.
        board: what is looked for.
        camera: that took the image, where it is known.
        mirrored: whether it shows the world reflected.
    """
    discs = find_discs(image)
    nearest = board.spacing * (1.0 if board.layout == "symmetric" else np.sqrt(2.0))
    best: IntArray = np.zeros((0, 2), dtype=np.int64)
    for numbers, keys in disc_lattices(discs, 2.0 * nearest / board.diameter, mirrored=mirrored)[:_TRIED]:
        placing = place_pattern(keys, discs.pixels[numbers], _lattice(board))
        if placing is not None:
            view = BoardView.of(board, placing.ids, discs.pixels[numbers], turnable=placing.turnable)
            return view if camera is None else _centred(view, board, camera)
        best = keys if len(keys) > len(best) else best
    return BoardView.nothing(_reason(best, board))


def _lattice(board: CircleGrid) -> IntArray:
    """Columns and rows (n, 2) on the square lattice of the discs; an asymmetric one stands on its corner."""
    places = np.rint(board.places).astype(np.int64)
    if board.layout == "symmetric":
        return places
    x, y = places.T
    return np.stack([(x + y) // 2, (y - x) // 2], axis=1)


def _centred(view: BoardView, board: CircleGrid, camera: CentralModel) -> BoardView:
    """Move centroids to the images of the centres, as they differ at the board's pose; twice is enough."""
    pixels = view.pixels
    for _ in range(_ROUNDS):
        pose = board_pose(camera, pixels, view.object_points)
        if pose is None:
            return view
        angle = np.linspace(0.0, 2.0 * np.pi, _OUTLINE, endpoint=False)
        rim = 0.5 * board.diameter * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
        outline, seen = camera.project(pose.apply((view.object_points[:, None] + rim).reshape(-1, 3)))
        centre, ok = camera.project(pose.apply(view.object_points))
        ok &= seen.reshape(-1, _OUTLINE).all(axis=1)
        bias = _centroid(outline.reshape(-1, _OUTLINE, 2)) - centre
        moved = np.where(ok[:, None], view.pixels - bias, view.pixels)
        done = np.abs(moved - pixels).max() < 1e-4
        pixels = moved
        if done:
            break
    return BoardView(pixels, view.object_points, view.ids, turnable=view.turnable)


def _centroid(outline: FloatArray) -> FloatArray:
    """Centroids (n, 2) of the areas inside polygons (n, m, 2)."""
    away = outline - outline.mean(axis=1, keepdims=True)
    after = np.roll(away, -1, axis=1)
    cross = away[..., 0] * after[..., 1] - away[..., 1] * after[..., 0]
    total = (cross[..., None] * (away + after)).sum(axis=1) / (3.0 * cross.sum(axis=1))[:, None]
    return np.asarray(outline.mean(axis=1) + total)


def _reason(keys: IntArray, board: CircleGrid) -> str:
    needed = f"{board.columns}×{board.rows} discs ({board.layout})"
    if len(keys) < 4:
        return f"no grid of {needed}"
    columns, rows = counted_size(keys)
    return (
        f"a grid of {columns}×{rows} discs ({len(keys)} in all) was found, not {needed}: "
        "another board, or too small a part of it"
    )
