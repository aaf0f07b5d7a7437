"""What `estimate_two_view` is given, checked, in the pixels of the unified image."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras.conversion import UnifiedImage
from omniservo.errors import InputError
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS
from omniservo.geometry.arrays import FloatArray, IntArray, finite_array, finite_number

ASSUMED_NOISE_PX = 0.5
"""of fewer than eight matches where none is stated: they leave too few residuals to tell."""

NO_SQUARES: IntArray = np.empty((0, 4), dtype=np.int64)

_SHORTEST, _LONGEST = 1e-9, 1e9
"""[m] that give a scale: squares of shorter and longer ones leave the range of floating-point numbers"""


def stated_length(name: str, value: Any) -> float:
    """Return a length that gives a scale [m].

    Raises:
        InputError: not a number, or not from 1e-9 to 1e9.
    """
    return finite_number(name, value, minimum=_SHORTEST, maximum=_LONGEST)


def checked_pixels(
    image: UnifiedImage, pixels_initial: npt.ArrayLike, pixels_goal: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return both images' pixels side by side (n, 4), and how large each is in the unified image (n, 2)."""
    initial = finite_array("pixels_initial", pixels_initial, (None, 2))
    goal = finite_array("pixels_goal", pixels_goal, (None, 2))
    if len(initial) != len(goal):
        raise InputError(
            f"pixels_initial, pixels_goal: {len(initial)} and {len(goal)} rows given; row j of both must show"
            " the same point"
        )
    if len(initial) == 0:
        raise InputError("pixels_initial: no pixel given")
    scales = np.stack([image.scale(initial), image.scale(goal)], axis=1)
    return np.concatenate((initial, goal), axis=1), scales


def checked_noise(noise: Any, px: FloatArray) -> FloatArray | None:
    """Return σ of each point in either image (n, 2) [px]; ``px`` (n, 2) is what one of the camera's is."""
    n = len(px)
    if noise is None:
        return ASSUMED_NOISE_PX * px if n < EIGHT_POINTS else None
    if np.ndim(noise) == 0:
        return finite_number("noise", noise, above=0.0) * px
    sigmas = finite_array("noise", noise, (None, 2))
    if len(sigmas) != n:
        raise InputError(f"noise: {len(sigmas)} rows given; {n} are needed, one for each match")
    if sigmas.min() <= 0.0:
        raise InputError(f"noise: {sigmas.min():g} given; legal: > 0")
    return sigmas * px


def checked_squares(squares: npt.ArrayLike | None, n: int) -> IntArray:
    """Return (m, 4) places of matches; no match is a corner of two squares."""
    if squares is None:
        return NO_SQUARES
    places = np.asarray(squares)
    if places.ndim != 2 or places.shape[1] != 4 or places.dtype.kind not in "iu":
        raise InputError(f"squares: {places.dtype} {places.shape} given; whole numbers (m, 4) are needed")
    if places.size and not 0 <= places.min() <= places.max() < n:
        raise InputError(f"squares: {places.min()} to {places.max()} given; legal: 0 to {n - 1}")
    if len(np.unique(places)) < places.size:
        raise InputError("squares: a match stands twice; it is a corner of one square")
    return places.astype(np.int64)


def checked_windows(windows: npt.ArrayLike | None, px: FloatArray) -> FloatArray | None:
    """Return the standard deviation of each match's window (n,) [px]."""
    if windows is None:
        return None
    widths = finite_array("windows", windows, (None,))
    if len(widths) != len(px):
        raise InputError(f"windows: {len(widths)} numbers given; {len(px)} are needed, one for each match")
    if widths.min() <= 0.0:
        raise InputError(f"windows: {widths.min():g} given; legal: > 0")
    return widths * px[:, 0]


def check_choice(name: str, given: str, legal: tuple[str, ...]) -> None:
    """Raise InputError where something else is given."""
    if given not in legal:
        raise InputError(f"{name}: {given!r} given; legal: {', '.join(legal)}")


def checked_scale(scale: Any, sigma: Any, n: int) -> tuple[tuple[int, int] | None, float | None]:
    """Return the pair of points and the length that fix the scale."""
    finite_number("scale_sigma", sigma, minimum=0.0, maximum=0.0 if scale is None else 1.0)
    legal = "legal: None, metres between the camera centres, or ((i, j), metres) between two points"
    if scale is None:
        return None, None
    if not isinstance(scale, tuple | list):
        return None, stated_length("scale", scale)
    if len(scale) != 2 or not isinstance(scale[0], tuple | list) or len(scale[0]) != 2:
        raise InputError(f"scale: {scale!r} given; {legal}")
    indices = []
    for index in scale[0]:
        if isinstance(index, bool) or not isinstance(index, int | np.integer) or not 0 <= index < n:
            raise InputError(f"scale: index {index!r} given; legal: whole numbers from 0 to {n - 1}")
        indices.append(int(index))
    if indices[0] == indices[1]:
        raise InputError(f"scale: point {indices[0]} given twice; two different points are needed")
    return (indices[0], indices[1]), stated_length("scale: metres", scale[1])
