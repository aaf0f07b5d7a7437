"""When a sensor's rows see: instants of an exposure, and what each row takes from each of them."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.scenes import Sensor


def exposure_times(sensor: Sensor, height: int, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return instants t (steps + 1,) [s] since the time stamp, and weights W (steps + 1, height).

    With an image that changes evenly between neighbouring instants, row v's mean over its exposure
    [s_v − T/2, s_v + T/2], s_v = (v + ½ − H/2)/H · R, is Σ_k W_kv · image(t_k), for exposure T and
    readout R; for T = 0 it is the image at s_v. Each row's weights are not negative and add to 1.

    Args:
        sensor: states T and R; one of them is not 0.
        height: H.
        steps: between the instants, 1 or more.
    """
    times = np.linspace(-sensor.half_span, sensor.half_span, steps + 1)
    step, middle = times[1] - times[0], ((np.arange(height) + 0.5) / height - 0.5) * sensor.readout
    if sensor.exposure < 1e-6 * step:
        return times, np.maximum(1.0 - np.abs(middle - times[:, None]) / step, 0.0)
    ends = middle + 0.5 * sensor.exposure * np.array([[-1.0], [1.0]])
    before = _below_hat((ends[:, None] - times[:, None]) / step)
    return times, np.maximum(before[1] - before[0], 0.0) * step / sensor.exposure


def _below_hat(x: FloatArray) -> FloatArray:
    """∫ max(0, 1 − |s|) ds from −∞ to x."""
    inside = np.clip(x, -1.0, 1.0)
    return np.asarray(0.5 + inside - 0.5 * inside * np.abs(inside))
