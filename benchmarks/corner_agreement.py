"""How near to the corners stated with real images can a detector be that makes no error?

Run: ``python -m benchmarks.corner_agreement``; reads ``../shared/data`` as `benchmarks.board_corners` does.

Nobody knows the true corners. Each is predicted from the others of its view, without itself: by a calibrated
camera and pose, and by a polynomial of the place on the board for what those leave (a bent board, a lens that
the model does not meet). What such a prediction misses is the corner's own error and the prediction's.
A shift that changes slowly over the image stays unseen by this; the second table looks for it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt
from benchmarks.board_corners import (
    BOARDS,
    DATA,
    NEAR,
    SETS,
    draw_pose,
    share_near,
    stated_views,
)
from benchmarks.tables import print_table
from scipy.ndimage import gaussian_filter, map_coordinates
from tests.calibration import rendered_boards

from omniservo import calibrate_camera
from omniservo.calibration.boards import Board, find_board, read_grey_image
from omniservo.calibration.boards.local_map import local_map
from omniservo.calibration.boards.saddle_fit import LARGEST_RADIUS
from omniservo.calibration.boards.saddle_kernels import PARAMETERS, fit_crossings
from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import ByteArray

Array = npt.NDArray[np.float64]
RADII = (5.0, 7.0, LARGEST_RADIUS, 11.0)
"""[px] of the window of our fit"""
RENDERED = UnifiedCamera(720.0, 720.0, 640.0, 480.0, 1.0, 1280, 960)
POSES = 6
TAILS = (0.0, 5.0)
"""[px] see `rendered_views`"""
_DEGREE = 4  # of the polynomials of the place: 15 terms for 48 corners or more
_AGREE = 0.15  # [px]
_REACH = 0.65  # of a square
_PROFILE = np.arange(-8.0, 8.1, 0.5)  # [px] across an edge
_LEAST_SQUARE, _LEAST_STEP = 20.0, 40.0  # [px], [grey values] edges whose profile is looked at


@dataclass(frozen=True)
class View:
    """One image, its board, and the corners in the stated order."""

    image: ByteArray
    board: Board
    stated: Array
    ours: Array

    @cached_property
    def axes(self) -> Array:
        """(n, 2, 2) [px] columns: to the next corner in +x and +y."""
        return local_map(self.board.places, self.ours, self.board.places)[1]

    @cached_property
    def heights(self) -> Array:
        """(n,) [px] of the squares, the smaller way across."""
        sides = np.linalg.norm(self.axes, axis=1).max(axis=1)
        return np.asarray(np.abs(np.linalg.det(self.axes)) / sides)


def views_of(folder: str) -> list[View]:
    """Find the boards in all images of a set."""
    return [_paired(read_grey_image(path), board, stated) for path, board, stated in stated_views(folder)]


def rendered_views(tail: float, seed: int = 1) -> list[View]:
    """Render a board at drawn poses; stated is the truth.

    A quarter of the light falls ``tail`` px nearer to the image's centre than the rest at its left and right
    border, less within; the blur's centroid is on the truth.
    """
    rng, board, views = np.random.default_rng(seed), BOARDS["checkerboard"], []
    for k in range(POSES):
        pose = draw_pose(RENDERED, board, rng)
        sharp = rendered_boards.render(RENDERED, board, pose, blur=0.5, noise=0.0).astype(np.float32)
        v, u = np.mgrid[0 : RENDERED.height, 0 : RENDERED.width].astype(np.float32)
        x, y = ((c - m) / RENDERED.cx for c, m in ((u, RENDERED.cx), (v, RENDERED.cy)))
        image = np.zeros_like(sharp)
        for part, inward in ((0.75, -0.25 * tail), (0.25, 0.75 * tail)):
            moved = (np.float32(c + inward * o) for c, o in ((u, x), (v, y)))
            image += part * cv2.remap(gaussian_filter(sharp, 0.6), *moved, cv2.INTER_CUBIC)
        noisy = image + 2.0 * np.random.default_rng(k).standard_normal(image.shape)
        image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
        truth, _ = rendered_boards.true_pixels(RENDERED, board, pose)
        views.append(_paired(image, board, truth))
    return views


def _paired(image: ByteArray, board: Board, stated: Array) -> View:
    found = find_board(image, board).pixels
    nearest = np.linalg.norm(found[None] - stated[:, None], axis=2).argmin(axis=1)
    return View(image, board, stated, found[nearest])


@dataclass(frozen=True)
class Judged:
    """Corners of a set against a camera that is calibrated from them."""

    centre: Array
    """(2,) [px] principal point"""
    rms_px: float
    modelled: Array
    """(n, 2) [px] corner − projection"""
    left_out: Array
    """(n, 2) [px] corner − its prediction without itself"""
    noise_px: float
    """rms distance from the smooth map, freed of what the map takes up"""


def judge(views: list[View], corners: list[Array]) -> Judged:
    """Calibrate from these corners, and predict each from the others of its view."""
    height, width = views[0].image.shape
    targets = [view.board.points for view in views]
    fit = calibrate_camera(corners, targets, (width, height), distortion="radtan")
    assert fit.camera is not None, fit.message
    assert not fit.views_dropped, fit.views_dropped
    modelled, left_out, own = [], [], []
    for k, view in enumerate(views):
        terms = _terms(view.board)
        smooth = terms @ np.linalg.pinv(terms)
        free = 1.0 - np.diag(smooth)[:, None]
        modelled.append(-fit.residuals[k])
        rest = modelled[-1] - smooth @ modelled[-1]
        left_out.append(rest / free)
        own.append(rest / np.sqrt(free))
    noise = float(np.sqrt((np.concatenate(own) ** 2).sum(axis=1).mean()))
    centre = np.array([fit.camera.cx, fit.camera.cy])
    return Judged(centre, fit.rms_px, np.concatenate(modelled), np.concatenate(left_out), noise)


def _terms(board: Board) -> Array:
    """(n, 15) polynomials of the corners' places."""
    x, y = (2 * (board.places - board.places.min(axis=0)) / np.ptp(board.places, axis=0) - 1).T
    all_terms = np.polynomial.legendre.legvander2d(x, y, [_DEGREE, _DEGREE])
    order = np.add.outer(np.arange(_DEGREE + 1), np.arange(_DEGREE + 1)).ravel()
    return np.asarray(all_terms[:, order <= _DEGREE])


def attainable_row(views: list[View], ours: Judged, stated: Judged) -> str:
    """Share of stated corners that error-free predictions would meet, and whose own error is larger."""
    both = judge(views, [(view.ours + view.stated) / 2 for view in views])
    a, b = (np.concatenate([getattr(view, kind) for view in views]) for kind in ("ours", "stated"))
    predicted = (b - stated.left_out, a - ours.left_out, (a + b) / 2 - both.left_out)
    shares = " | ".join(share_near(b - corners) for corners in predicted)
    apart = np.linalg.norm(a - b, axis=1) > NEAR
    nearer = np.linalg.norm(ours.left_out, axis=1) < np.linalg.norm(stated.left_out, axis=1)
    return (
        f"{share_near(stated.modelled)} | {shares} | {share_near(ours.left_out)} | {stated.noise_px:.3f} | "
        f"{ours.noise_px:.3f} | {apart.sum()} | {nearer[apart].sum()}"
    )


def shift_row(views: list[View], centre: Array) -> str:
    """How the ways to find a corner differ along the radius, and what is left without that."""
    a, b = (np.concatenate([getattr(view, kind) for view in views]) for kind in ("ours", "stated"))
    offset = a - centre
    radius = np.linalg.norm(offset, axis=1)[:, None]
    powers = np.stack([(offset * (radius / radius.max()) ** k).ravel() for k in (0, 2, 4)], axis=1)
    shift = (powers @ np.linalg.lstsq(powers, (b - a).ravel())[0]).reshape(-1, 2)
    outer = radius[:, 0] > radius.max() / 2

    symmetric = np.concatenate([_symmetric(view) for view in views])
    ways = []
    for other in (b, np.concatenate([_sub_pix(view) for view in views]), symmetric):
        found = np.isfinite(other[:, 0])
        outward = np.median(((other - a) * offset / radius).sum(axis=1)[outer & found])
        ways.append(f"{outward:+.3f}" + (f" | {share_near((other - b)[found])}" if other is not b else ""))
    blur = _blur_centre(views, centre, float(radius.max()) / 2)
    return (
        f"{blur:+.3f} | {' | '.join(ways)} | {_outvoted(b, a, symmetric)} | {_outvoted(a, b, symmetric)} | "
        f"{share_near(b - a)} | {share_near(b - a - shift)}"
    )


def _outvoted(one: Array, two: Array, third: Array) -> int:
    """Count corners where ``two`` and ``third`` agree and ``one`` is away from both."""
    agree = np.linalg.norm(two - third, axis=1) <= _AGREE
    apart = np.minimum(np.linalg.norm(one - two, axis=1), np.linalg.norm(one - third, axis=1)) > NEAR
    return int((agree & apart).sum())


def _sub_pix(view: View) -> Array:
    """OpenCV's cornerSubPix, with a window of 0.45 squares a side of the corner."""
    half = np.clip(np.rint(0.45 * view.heights), 2, 11).astype(int)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 60, 1e-4)
    starts = view.ours.astype(np.float32)[:, None, None]
    found = [
        cv2.cornerSubPix(view.image, p.copy(), (int(h), int(h)), (-1, -1), stop)
        for p, h in zip(starts, half, strict=True)
    ]
    return np.asarray(found, dtype=np.float64).reshape(-1, 2)


def _symmetric(view: View) -> Array:
    """OpenCV's findChessboardCornersSB, which looks for symmetry; NaN where it finds nothing."""
    across = tuple(int(n) for n in view.board.places.max(axis=0) + 1)
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    ok, found = cv2.findChessboardCornersSB(view.image, across, flags=flags)
    if not ok:
        return np.full_like(view.ours, np.nan)
    away = found.reshape(1, -1, 2) - view.ours[:, None]
    nearest = away[np.arange(len(away)), np.linalg.norm(away, axis=2).argmin(axis=1)]
    lost = np.linalg.norm(nearest, axis=1) > 0.3 * view.heights
    return np.asarray(np.where(lost[:, None], np.nan, view.ours + nearest))


def _blur_centre(views: list[View], centre: Array, least_radius: float) -> float:
    """Median over edges across the radius: the blur's centroid, outward of the edge's half-way grey [px].

    With g(s) the edge's profile from 0 inside to 1 outside and g(0) = ½ it is −∫₀ g(s) + g(−s) − 1 ds:
    nought if the blur is symmetric.
    """
    found: list[float] = []
    for view in views:
        places = view.board.places
        for way in (0, 1):
            half = places[places[:, way] < places[:, way].max()] + 0.5 * np.eye(2)[way]
            pixels, axes, _ = local_map(places, view.ours, half)
            for pixel, axis in zip(pixels, axes, strict=True):
                length = float(np.linalg.norm(axis[:, way]))
                along, out = axis[:, way] / length, pixel - centre
                across = np.array([-along[1], along[0]]) * np.sign(along[0] * out[1] - along[1] * out[0])
                wide = abs(np.linalg.det(axis)) / length > _LEAST_SQUARE
                if wide and across @ out > max(0.9 * np.linalg.norm(out), least_radius):
                    found += _centroid(view.image, pixel, across, along)
    return float(np.median(found))


def _centroid(image: ByteArray, pixel: Array, across: Array, along: Array) -> list[float]:
    """Give the blur's centroid of one edge, or nothing where the edge is faint."""
    beside = np.arange(-1.5, 2.0)[:, None, None] * along
    points = pixel + _PROFILE[:, None] * across + beside
    profile = map_coordinates(
        image.astype(float), np.moveaxis(points, 2, 0)[::-1], order=1, mode="nearest"
    ).mean(0)
    low, high = profile[:5].mean(), profile[-5:].mean()
    if abs(high - low) < _LEAST_STEP:
        return []
    grey = (profile - low) / (high - low)
    rises = np.flatnonzero((grey[:-1] < 0.5) & (grey[1:] >= 0.5))
    if len(rises) == 0:
        return []
    k = int(rises[np.abs(_PROFILE[rises]).argmin()])
    middle = _PROFILE[k] + 0.5 * (0.5 - grey[k]) / (grey[k + 1] - grey[k])
    s = np.arange(0.0, 5.1, 0.25)
    uneven = np.interp(middle + s, _PROFILE, grey) + np.interp(middle - s, _PROFILE, grey) - 1
    return [-float(np.trapezoid(uneven, s))]


def window_row(views: list[View], radius: float) -> str:
    """Fit our corners in a window of this radius: agreement with the stated ones, rms, own error."""
    corners = []
    for view in views:
        states, results = np.zeros((len(view.ours), PARAMETERS)), np.zeros((len(view.ours), 3))
        limits, seen = np.array([_REACH, _REACH, radius]), np.zeros((0, 0), dtype=np.bool_)
        fit_crossings(view.image, view.ours, np.ascontiguousarray(view.axes), limits, seen, states, results)
        corners.append(view.ours + states[:, :2])
    off = np.concatenate(corners) - np.concatenate([view.stated for view in views])
    fit = judge(views, corners)
    return f"{share_near(off)} | {fit.rms_px:.3f} | {fit.noise_px:.3f}"


def rows() -> tuple[list[str], list[str], list[str]]:
    """Measure the three tables' rows."""
    attainable, shifts, windows = [], [], []
    for folder in SETS:
        views = views_of(folder)
        ours, stated = (judge(views, [getattr(view, kind) for view in views]) for kind in ("ours", "stated"))
        attainable.append(f"{folder} | {attainable_row(views, ours, stated)}")
        shifts.append(f"{folder} | {shift_row(views, ours.centre)}")
        windows += [f"{folder} | {radius:.0f} | {window_row(views, radius)}" for radius in RADII]
    for tail in TAILS:
        views = rendered_views(tail)
        centre = np.array([RENDERED.cx, RENDERED.cy])
        shifts.append(f"rendered, tail {tail:.0f} px | {shift_row(views, centre)}")
    return attainable, shifts, windows


def main() -> None:
    """Print the tables as Markdown."""
    if not DATA.exists():
        print(f"real images: {DATA} is absent")
        return
    attainable, shifts, windows = rows()
    left = "predicted from stated | from ours | from both | ours, predicted from ours"
    own = "own error, stated [px] | ours [px] | apart | of these, ours nearer"
    print_table(f"| images | camera and pose alone | {left} | {own} |", attainable)
    print()
    others = "stated | cornerSubPix | ≤ 0.3 px of stated | findChessboardCornersSB | ≤ 0.3 px of stated"
    odd = "stated alone apart | ours alone apart"
    ends = "ours ≤ 0.3 px of stated | without the radial part"
    print_table(f"| images | blur's centroid [px] | {others} | {odd} | {ends} |", shifts)
    print()
    print_table("| images | window's radius | ≤ 0.3 px of stated | calibration's rms | own error |", windows)


if __name__ == "__main__":
    main()
