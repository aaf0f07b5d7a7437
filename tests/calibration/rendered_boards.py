"""Pictures of boards with known points: each pixel is the mean of many rays, then blur and noise.

The patterns are written down here from the boards' definitions, not taken from the code that is tested.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.calibration.boards import AprilGrid, CharucoBoard, Checkerboard, CircleGrid
from omniservo.cameras import DeadZone

DARK, BRIGHT, AROUND = 0.08, 0.85, 0.4
RAYS = 6  # a side, in pixels with an edge


def shade(board, x, y, tag_border=2):
    """Grey in [0, 1] of points (x, y) [m] of the board's plane."""
    if isinstance(board, CharucoBoard):
        return _charuco(board, x / board.square, y / board.square)
    if isinstance(board, Checkerboard):
        u, v = x / board.square + 1, y / board.square + 1
        dark = (np.floor(u) + np.floor(v)) % 2 == 0
        return _sheet(u, v, board.columns + 1, board.rows + 1, dark)
    if isinstance(board, AprilGrid):
        return _aprilgrid(board, x / board.tag, y / board.tag, tag_border)
    if isinstance(board, CircleGrid):
        step = board.spacing
        j = np.clip(np.rint(y / step), 0, board.rows - 1)
        if board.layout == "symmetric":
            centre = np.clip(np.rint(x / step), 0, board.columns - 1)
        else:
            centre = 2 * np.clip(np.rint((x / step - j % 2) / 2), 0, board.columns - 1) + j % 2
        dark = np.hypot(x - centre * step, y - j * step) < board.diameter / 2
        wide = board.columns - 1 if board.layout == "symmetric" else 2 * board.columns - 1
        return _sheet(x / step + 1, y / step + 1, wide + 2, board.rows + 1, dark)
    raise TypeError(board)


def _sheet(u, v, width, height, dark, margin=0.6):
    inside = (u >= 0) & (u <= width) & (v >= 0) & (v <= height)
    paper = (u >= -margin) & (u <= width + margin) & (v >= -margin) & (v <= height + margin)
    return np.where(inside & dark, DARK, np.where(paper, BRIGHT, AROUND))


def _bits(dictionary, count, border):
    side = dictionary.markerSize + 2 * border
    return np.stack(
        [cv2.aruco.generateImageMarker(dictionary, k, side, borderBits=border) > 0 for k in range(count)]
    )


def _marker(bits, number, s, t):
    """Whether (s, t) in [0, 1]², t downwards, lies on a dark cell of the marker."""
    side = bits.shape[1]
    column, row = (np.clip((c * side).astype(int), 0, side - 1) for c in (s, t))
    return ~bits[number, row, column]


def _charuco(board, u, v):
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    dark = (column + row) % 2 == 0
    cells = np.argwhere(np.add.outer(np.arange(board.rows), np.arange(board.columns)) % 2 == 1)
    number = np.zeros((board.rows, board.columns), dtype=int)
    number[tuple(cells.T)] = np.arange(len(cells))
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    bits = _bits(dictionary, len(cells), 1)
    side = board.marker / board.square
    s, t = ((c - k - 0.5) / side + 0.5 for c, k in ((u, column), (v, row)))
    on = (s > 0) & (s < 1) & (t > 0) & (t < 1) & ~dark
    which = number[np.clip(row, 0, board.rows - 1), np.clip(column, 0, board.columns - 1)]
    dark = dark | (on & _marker(bits, which, s, t))
    return _sheet(u, v, board.columns, board.rows, dark)


def _aprilgrid(board, x, y, border):
    """Kalibr's: tags one gap apart, and in every crossing of gaps a dark square."""
    step = 1 + board.ratio
    column, row = np.floor(x / step), np.floor(y / step)
    s, t = x - column * step, y - row * step
    in_tag = (s < 1) & (t < 1) & (column >= 0) & (row >= 0) & (column < board.columns) & (row < board.rows)
    bits = _bits(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 587, border)
    number = np.clip(row * board.columns + column, 0, 586).astype(int)
    dark = (in_tag & _marker(bits, number, s, 1 - t)) | ((s > 1) & (t > 1))
    width, height = (n * step + board.ratio for n in (board.columns, board.rows))
    u, v = x + board.ratio, y + board.ratio
    return _sheet(u, v, width, height, dark, margin=0.15)


def render(camera, board, camera_T_board, *, blur=0.7, noise=2.0, seed=0, **pattern):
    """(height, width) uint8. The blur takes in what lies beyond the image's border."""
    pad = 8
    v, u = np.mgrid[-pad : camera.height + pad, -pad : camera.width + pad].astype(float)
    middle = _greys(camera, board, camera_T_board, np.stack([u, v], -1).reshape(-1, 2), pattern)
    image = middle.reshape(u.shape)
    edge = maximum_filter(image, 3) - minimum_filter(image, 3) > 0
    shift = (np.arange(RAYS) + 0.5) / RAYS - 0.5
    grid = np.stack(np.meshgrid(shift, shift), -1)
    # sheared, so that an edge along the pixels is not always met by a whole row of rays
    grid = (grid + np.stack([grid[..., 1], -grid[..., 0]], -1) / RAYS).reshape(1, -1, 2)
    at = np.stack([u[edge], v[edge]], -1)[:, None, :] + grid
    fine = _greys(camera, board, camera_T_board, at.reshape(-1, 2), pattern)
    image[edge] = fine.reshape(-1, RAYS * RAYS).mean(1)
    image = gaussian_filter(255 * image, blur) if blur else 255 * image
    image = image[pad:-pad, pad:-pad]
    image = image + noise * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def _greys(camera, board, camera_T_board, pixels, pattern):
    rays, valid = camera.unproject(pixels)
    rays = np.where(valid[:, None], rays, [0.0, 0.0, -1.0])
    normal = camera_T_board.rotation.as_matrix()[:, 2]
    depth = (normal @ camera_T_board.translation) / (rays @ normal)
    hit = camera_T_board.inv().apply(np.where(depth > 0, depth, 1.0)[:, None] * rays)
    grey = shade(board, hit[:, 0], hit[:, 1], **pattern)
    grey = np.where(depth > 0, grey, AROUND)
    zone = camera.dead_zone
    if zone is not None:
        valid = valid & (np.linalg.norm(pixels - zone.center, axis=1) > zone.radius)
    return np.where(valid, grey, 0.03)


def facing(board, direction, distance, lean=(0.0, 0.0), roll=0.0):
    """camera_T_board: the board's middle at ``distance`` [m] along ``direction``, its front to the camera.

    ``lean`` [rad] turns it about its own x and y, ``roll`` about its normal. An AprilGrid's z comes to the
    camera, the others' z goes away from it.
    """
    z = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0], z)
    x = x / np.linalg.norm(x)
    camera_R_front = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    turn = Rotation.from_euler("zxy", [roll, *lean])
    flip = Rotation.from_euler("x", np.pi if isinstance(board, AprilGrid) else 0.0)
    rotation = camera_R_front * turn * flip
    middle = 0.5 * (board.points.min(0) + board.points.max(0))
    return RigidTransform.from_components(distance * z - rotation.apply(middle), rotation)


def around(camera, board, camera_T_board, margin=30):
    """The part of the camera's image that shows the board: the same rays, fewer pixels."""
    pixels, seen = true_pixels(camera, board, camera_T_board)
    low = np.maximum(np.floor(pixels[seen].min(0)) - margin, 0)
    high = np.minimum(np.ceil(pixels[seen].max(0)) + margin, [camera.width - 1, camera.height - 1])
    width, height = (int(n) for n in high - low + 1)
    zone = camera.dead_zone
    zone = zone and DeadZone((zone.center[0] - low[0], zone.center[1] - low[1]), zone.radius)
    cx, cy = camera.cx - low[0], camera.cy - low[1]
    return replace(camera, cx=cx, cy=cy, width=width, height=height, dead_zone=zone)


def true_pixels(camera, board, camera_T_board):
    """(n, 2) [px] of the board's points and whether the camera sees them."""
    pixels, valid = camera.project(camera_T_board.apply(board.points))
    return pixels, valid & camera.in_image(pixels)
