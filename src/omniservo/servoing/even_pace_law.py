"""A time law for paths that move much faster in some places of w than in others."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.interpolate import CubicHermiteSpline

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.servoing.time_law import RestToRestLaw

_PLACES = 801
_LEAST_PACE = 0.05
"""of the mean: where the path stands, w runs on this much faster than on average"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class EvenPaceLaw:
    """From rest to rest in the length ℓ(w) = ∫ pace dw: ℓ(t) = ℓ(1)·(10u³ − 15u⁴ + 6u⁵), u = t/duration.

    So the largest speed is 1.875 of the mean one, however unevenly w runs over the path; that of
    `RestToRestLaw` is 1.875 of what the fastest place asks for.
    """

    pace: Callable[[FloatArray], FloatArray]
    """of w (m,): length per unit w (m,), such as ‖v‖; below 5% of its mean it counts as that"""
    top_speed: float
    """greatest ℓ̇ [1/s]; the duration follows from it"""
    least_duration: float = 0.0
    """[s]"""

    def __post_init__(self) -> None:
        finite_number("top_speed", self.top_speed, above=0.0)
        finite_number("least_duration", self.least_duration, minimum=0.0)
        if not max(self.least_duration, float(self._given.max())) > 0.0:
            raise InputError("pace: nothing moves; give a least_duration > 0")

    @cached_property
    def duration(self) -> float:
        """The law's [s]."""
        return max(self.least_duration, 1.875 * float(self._length[-1]) / self.top_speed)

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (w, ẇ [1/s]) at ``time`` [s]; (0, 0) before 0 and (1, 0) after the duration.

        Raises:
            InputError: the time is not finite.
        """
        share, speed = self._share(time)
        begins, cubics = self._pieces
        i = min(bisect_right(begins, share), len(cubics)) - 1
        x, (a, b, c, d) = share - begins[i], cubics[i]
        w, slope = ((a * x + b) * x + c) * x + d, (3.0 * a * x + 2.0 * b) * x + c
        return min(max(w, 0.0), 1.0), max(slope, 0.0) * speed

    def finished(self, time: float) -> bool:
        """Return whether ``time`` [s] has reached the duration."""
        return self._share.finished(time)

    def motion(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return w, ẇ [1/s] and ẅ [1/s²] at times (m,) [s], finite and ≥ 0."""
        share, speed, change = self._share.motion(times)
        first, second = self._place(share, 1), self._place(share, 2)
        w = np.clip(self._place(share), 0.0, 1.0)
        return w, first * speed, first * change + second * speed**2

    @cached_property
    def _given(self) -> FloatArray:
        return finite_array("pace", self.pace(np.linspace(0.0, 1.0, _PLACES)), (_PLACES,))

    @cached_property
    def _paces(self) -> FloatArray:
        return np.maximum(self._given, max(_LEAST_PACE * float(self._given.mean()), 1e-12))

    @cached_property
    def _length(self) -> FloatArray:
        pace, step = self._paces, 1.0 / (_PLACES - 1)
        pieces = np.diff(cumulative_simpson(pace, dx=step, initial=0.0))
        ends = pace[:-1], pace[1:]  # beside a jump Simpson's parabola can leave what lies between them
        pieces = np.clip(pieces, step * np.minimum(*ends), step * np.maximum(*ends))
        return np.concatenate([[0.0], np.cumsum(pieces)])

    @cached_property
    def _place(self) -> CubicHermiteSpline:
        """Place w of the share of the length; no slope is so steep that w would fall (Fritsch–Carlson)."""
        share, places = self._length / self._length[-1], np.linspace(0.0, 1.0, _PLACES)
        secants = np.diff(places) / np.diff(share)
        most = 3.0 * np.minimum(np.append(secants, np.inf), np.append(np.inf, secants))
        return CubicHermiteSpline(share, places, np.minimum(self._length[-1] / self._paces, most))

    @cached_property
    def _pieces(self) -> tuple[list[float], list[list[float]]]:
        """Where each cubic of `_place` begins, and its coefficients: SciPy takes 10 µs for one time."""
        return self._place.x.tolist(), self._place.c.T.tolist()

    @cached_property
    def _share(self) -> RestToRestLaw:
        return RestToRestLaw(self.duration)
