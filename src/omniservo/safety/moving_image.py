"""What the motion of the image during its own exposure does, and stops that are named after it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from omniservo.errors import Divergence, FeatureLoss, InconsistentImage, ServoStop
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.safety.safety_options import SafetyOptions

NAMED_BLUR = 2.0
"""[px] in an exposure: from here on dots are lost; points lost while they moved so far are lost to it"""
NAMED_SKEW = 4.0
"""[px] between the first row and the last; points that disagree while they moved so far do for it"""


class MotionBlur(FeatureLoss):
    """Too few features are left while the image moves fast during its exposure."""

    reason = "motion_blur"


class RollingShutter(ServoStop):
    """The points contradict the motion while the image moves fast between its first row and its last."""

    reason = "rolling_shutter"


class MovingImage:
    """How the points move through the image while it is exposed and read, by the controller's prediction.

    Args:
        options: exposure and readout.
        height: of the image [px].
    """

    def __init__(self, options: SafetyOptions, height: int) -> None:
        self._options, self._height = options, height
        self._flow: FloatArray | None = None

    def predict(self, predicted: Callable[[float], tuple[FloatArray, BoolArray]], time: float) -> None:
        """Take in where points are predicted at the image's time and just after it [s]."""
        span = max(self._options.exposure, self._options.readout)
        if span > 0.0:
            (now, here), (after, there) = predicted(time), predicted(time + span)
            self._flow = np.where((here & there)[:, None], (after - now) / span, 0.0)

    def displaced(self, pixels: FloatArray) -> FloatArray:
        """Return by how much points at ``pixels`` (n, 2) are off their places at the time stamp (n, 2) [px].

        Row v of H sees (v + ½ − H/2)/H · readout after the stamp; a point moves on by its predicted flow.
        """
        if self._flow is None or self._options.readout == 0.0:
            return np.zeros_like(pixels)
        late = ((pixels[:, 1] + 0.5) / self._height - 0.5) * self._options.readout
        return np.asarray(late[:, None] * self._flow)

    def named(self, stop: ServoStop) -> ServoStop:
        """Return a stop by the name of motion blur or rolling shutter, where that explains it."""
        if self._flow is None or not len(self._flow):
            return stop
        speed = float(np.median(np.linalg.norm(self._flow, axis=1)))
        exposure, readout = self._options.exposure, self._options.readout
        if isinstance(stop, FeatureLoss) and speed * exposure >= NAMED_BLUR:
            moved = f"motion blur: {speed * exposure:.0f} px during the exposure of {1e3 * exposure:g} ms"
            return MotionBlur(f"{moved}; {stop}")
        if isinstance(stop, Divergence | InconsistentImage) and speed * readout >= NAMED_SKEW:
            moved = f"rolling shutter: {speed * readout:.0f} px during the readout of {1e3 * readout:g} ms"
            return RollingShutter(f"{moved}; {stop}")
        return stop
