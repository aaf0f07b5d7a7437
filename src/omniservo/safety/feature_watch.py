"""What the image must give before a robot may be moved by it: enough points, spread, and no growing error."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

import numpy as np

from omniservo.errors import Divergence, FeatureLoss, NotFinite, SingularInteraction
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.safety.safety_options import SafetyOptions
from omniservo.servoing.control_law import LEAST_CONDITIONING, singular_message, solve_twist
from omniservo.servoing.interaction import BEARING, write_interaction


class FeatureWatch:
    """Looks at the points of every control step, whatever controller uses them.

    Args:
        options: see SafetyOptions.
    """

    def __init__(self, options: SafetyOptions) -> None:
        self._options = options
        self._errors: deque[tuple[float, float]] = deque()
        self._reference: tuple[float, FloatArray] | None = None

    def check(
        self, time: float, points: FloatArray, valid: BoolArray, error_px: float, reference: FloatArray
    ) -> None:
        """Take one step in.

        Args:
            time: of the image [s].
            points: (n, 3) in the camera frame, as estimated [m].
            valid: (n,) the points seen in the image.
            error_px: rms distance of the points to their reference [px].
            reference: (n, 2) where that is [px], NaN where there is none.

        Raises:
            FeatureLoss: fewer points than ``least_features`` are seen.
            SingularInteraction: they lie so close together, or so badly, that they determine no twist.
            Divergence: the error is above ``growing_px``, and above what a reference that moves at its speed
                leaves behind in ``drive_lag``, and grew from third to third of ``growing_time``.
            NotFinite: a seen point has no finite place, or the error is NaN.
        """
        count = int(valid.sum())
        if count < self._options.least_features:
            raise FeatureLoss(
                f"{count} of {len(valid)} points are seen; at least {self._options.least_features} are needed"
            )
        seen = np.ascontiguousarray(points[valid], dtype=np.float64)
        if not np.isfinite(seen).all() or np.isnan(error_px):
            raise NotFinite(f"the estimate of the points is not finite, or their error: {error_px} px")
        rows, exist = np.empty((count, 3, 6)), np.empty(count, dtype=np.bool_)
        write_interaction(BEARING, seen, rows, exist)
        conditioning = solve_twist(rows.reshape(-1, 6), np.zeros(3 * count), np.empty(6))
        if not conditioning >= LEAST_CONDITIONING:
            raise SingularInteraction(singular_message(count, conditioning))
        self._refuse_growth(time, error_px, self._left_behind(time, reference))

    def _left_behind(self, time: float, reference: FloatArray) -> float:
        """Return how far the reference moves while a sound drive lags [px]."""
        before, self._reference = self._reference, (time, np.array(reference))
        if before is None or time <= before[0] or before[1].shape != reference.shape:
            return 0.0
        moved = np.sum((reference - before[1]) ** 2, axis=1)
        moved = moved[np.isfinite(moved)]
        speed = math.sqrt(moved.mean()) / (time - before[0]) if len(moved) else 0.0
        return self._options.drive_lag * speed

    def _refuse_growth(self, time: float, error_px: float, left_behind: float) -> None:
        """Stop where the least error of each third of the last ``growing_time`` is above the worst before."""
        span = self._options.growing_time
        self._errors.append((time, error_px))
        while self._errors[-1][0] - self._errors[0][0] > span:
            self._errors.popleft()
        if error_px <= self._options.growing_px + left_behind or time - self._errors[0][0] < 0.8 * span:
            return
        times, errors = np.array(self._errors).T
        thirds = np.digitize(times, times[0] + (times[-1] - times[0]) * np.array([1.0, 2.0]) / 3.0)
        parts = [errors[thirds == k] for k in range(3)]
        if all(len(p) for p in parts) and all(b.min() > a.max() for a, b in pairwise(parts)):
            raise Divergence(
                f"the image error grew for {times[-1] - times[0]:.2f} s, from {errors[0]:.1f} to "
                f"{error_px:.1f} px; above {self._options.growing_px:g} px it may not"
            )
