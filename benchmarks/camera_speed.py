"""Projecting 10⁶ points and unprojecting 10⁶ pixels with every model, beside OpenCV where it has the model.

Run: ``python -m benchmarks.camera_speed``. One core; OpenCV is set to one thread. Times are the core's own,
the least of several warm calls in turn, because other load only adds. The pixels are spread evenly over the
image, the points are their rays. OpenCV's unprojection gives points of the plane Z = 1, ours unit vectors and
validity; its projection gives derivatives too. The last column is the largest distance from a pixel to the
projection of what OpenCV's unprojection gives for it, with its own default stopping rule; ours is below 1e-9.
The pinhole model's inverse is measured once more with OpenCV told to go on until 1e-12 or 100 steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from time import thread_time

import cv2
import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import (
    CentralModel,
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    OcamPolynomial,
    Pinhole,
)
from omniservo.geometry.arrays import FloatArray

COUNT = 1_000_000
REPEATS = 7
PROJECT_MS, UNPROJECT_MS = 50.0, 100.0

_KB = (0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182)
_BARREL = (-0.28, 0.07, 1e-3, -5e-4, 0.01, 0.1, 0.02, 0.003, 1e-3, 2e-3, -1e-3, 5e-4, 0.02, -0.03)
_LONGER = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
_OCAM = (-153.467, 0.0, 1.034692e-3, 5.138226e-6, -5.694855e-9)

CAMERAS: dict[str, CentralModel] = {
    "unified": UnifiedCamera(296.9, 298.4, 316.8, 254.9, 1.291, 659, 432),
    "unified, k1 k2 p1 p2": UnifiedCamera(
        1476.0, 1476.0, 703.0, 690.0, 2.213, 1400, 1400, distortion=(0.016, 1.65, -3.9e-4, -4e-4)
    ),
    "Kannala-Brandt": KannalaBrandt(190.978, 190.973, 254.932, 256.897, 512, 512, k=_KB),
    "pinhole": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480),
    "pinhole, 5 numbers": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=_BARREL[:5]),
    "pinhole, 8 numbers": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=_BARREL[:8]),
    "pinhole, 14 numbers": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=_BARREL),
    "extended unified": ExtendedUnified(191.148, 191.132, 254.959, 256.882, 0.62911, 1.04181, 512, 512),
    "double sphere": DoubleSphere(158.286, 158.274, 254.961, 256.889, -0.172131, 0.593118, 512, 512),
    "OCam": OcamPolynomial(_OCAM, 456.346, 382.829, 1024, 768),
    "equirectangular": Equirectangular(2048, 1024),
}


@dataclass(frozen=True)
class Speed:
    """Milliseconds for 10⁶, ours and OpenCV's (NaN where it has none), and OpenCV's error [px]."""

    project: float
    unproject: float
    opencv_project: float
    opencv_unproject: float
    opencv_error: float
    opencv_longer: float = math.nan


def speed(camera: CentralModel) -> Speed:
    """Measure one camera."""
    rng = np.random.default_rng(0)
    pixels = rng.uniform(-0.5, [camera.width - 0.5, camera.height - 0.5], (COUNT, 2))
    rays, valid = camera.unproject(pixels)
    if not valid.all():
        pixels = pixels[valid][np.arange(COUNT) % valid.sum()]
        rays = rays[valid][np.arange(COUNT) % valid.sum()]
    calls: list[Callable[[], object]] = [lambda: camera.project(rays), lambda: camera.unproject(pixels)]
    theirs = _opencv(camera, rays, pixels)
    times = _least([*calls, *theirs])
    error = math.nan
    if theirs:
        plane = np.asarray(theirs[1]()).reshape(-1, 2)
        ahead = rays[:, 2] > 0.1  # OpenCV gives points of the plane Z = 1
        again = camera.project(np.column_stack([plane, np.ones(COUNT)])[ahead])[0]
        error = float(np.nanmax(np.hypot(*(again - pixels[ahead]).T)))
    times += [math.nan] * (5 - len(times))
    return Speed(*(1e3 * t for t in times[:4]), error, 1e3 * times[4])


def _least(calls: list[Callable[[], object]]) -> list[float]:
    times = [math.inf] * len(calls)
    for _ in range(REPEATS):
        for i, call in enumerate(calls):
            start = thread_time()
            call()
            times[i] = min(times[i], thread_time() - start)
    return times


def _opencv(camera: CentralModel, rays: FloatArray, pixels: FloatArray) -> list[Callable[[], object]]:
    """Return OpenCV's two calls, or none."""
    zero = np.zeros(3)
    if isinstance(camera, UnifiedCamera):
        K, D, xi = camera.matrix, np.array([camera.distortion]), camera.xi
        return [
            lambda: cv2.omnidir.projectPoints(rays[None], zero, zero, K, xi, D),
            lambda: cv2.omnidir.undistortPoints(pixels[None], K, D, np.array([xi]), np.eye(3)),
        ]
    if isinstance(camera, KannalaBrandt):
        K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
        D = np.array(camera.k)
        return [
            lambda: cv2.fisheye.projectPoints(rays[:, None], zero, zero, K, D),
            lambda: cv2.fisheye.undistortPoints(pixels[:, None], K, D),
        ]
    if isinstance(camera, Pinhole):
        K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
        D = np.array(camera.distortion)
        longer = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)  # OpenCV 5: one function
        return [
            lambda: cv2.projectPoints(rays, zero, zero, K, D),
            lambda: cv2.undistortPoints(pixels[:, None], K, D),
            lambda: longer(pixels[:, None], K, D, R=None, P=None, criteria=_LONGER),
        ]
    return []


def main() -> None:
    """Print the table as Markdown, row by row as it is measured."""
    cv2.setNumThreads(1)
    print(f"10⁶ points or pixels, ms; targets {PROJECT_MS:.0f} and {UNPROJECT_MS:.0f}\n")
    print(
        "| model | project | OpenCV | ratio | unproject | OpenCV | ratio | OpenCV, longer | its error [px] |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, camera in CAMERAS.items():
        s = speed(camera)
        there = [s.project, s.opencv_project, s.project / s.opencv_project]
        back = [s.unproject, s.opencv_unproject, s.unproject / s.opencv_unproject]
        cells = [_cell(v, 1) for v in there[:2]] + [_cell(there[2], 2)]
        cells += [_cell(v, 1) for v in back[:2]] + [_cell(back[2], 2), _cell(s.opencv_longer, 1)]
        print(f"| {name} | " + " | ".join(cells) + f" | {_scientific(s.opencv_error)} |", flush=True)


def _cell(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def _scientific(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.0e}"


if __name__ == "__main__":
    main()
