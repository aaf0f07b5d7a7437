"""The visibility filter: follows a commanded twist as closely as the points' staying in view allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import unified_limits
from omniservo.cameras.image_mask import outward_edges
from omniservo.cameras.models import CentralModel
from omniservo.cameras.unified_kernels import SQUARE
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array, finite_number
from omniservo.safety import visibility_kernel as kernel
from omniservo.safety.safety_options import SafetyOptions

_DELAY = 1
"""of the kernel's settings"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class FilteredTwist:
    """A twist that lets the points stay in view, and what that took."""

    twist: FloatArray
    """(6,) linear [m/s] and angular [rad/s], camera frame"""
    change: FloatArray
    """(6,) this twist minus the wanted one"""
    least_height_px: float
    """of the points above the limits with their margin, when the twist acts, as predicted [px]; inf without
    a point"""
    slack_px: float
    """what the point that is served worst lacks of ḣ ≥ −κ h [px/s]; above 0 only for points beyond a limit"""
    active: int
    """how many rows held the twist back"""
    solved: bool
    """False: the program was not solved, and the twist is zero"""


class VisibilityFilter:
    """Control barrier functions on the image: min ‖W(v − v*)‖² subject to ḣ ≥ −κ h.

    h is the distance [px] of a point's pixel to a limit of the image moved inward by ``visibility_margin``:
    the four edges, the lens's circle, the dead zone, and the mask's polygons (of each the edge that it lies
    farthest beyond); ḣ = ∇h · (−v − ω × c). W weighs metres by the points' mean distance (Ames et al.,
    *Control barrier functions: theory and applications*, 2019). The speed limits of the options hold too.
    Points are where their pixels were seen, at the estimate's distance; points that are not seen where the
    estimate puts them. Both are carried on until the twist acts, for ``delay``, by how the camera moves until
    then, or else by the last twist.

    Args:
        camera: takes the images; of any model. The limits are those of its unified form, moved inward by
            what the conversion leaves, so that they lie inside the own.
        delay: from the exposure of an image until its twist acts [s], where a step states none.
        options: margin, rate and speed limits.

    Raises:
        InputError: the delay is negative or not finite.
    """

    def __init__(
        self, camera: CentralModel, *, delay: float = 0.0, options: SafetyOptions | None = None
    ) -> None:
        self.camera = camera
        """as given"""
        self._options = options or SafetyOptions()
        self._image = unified_limits(camera)
        unified = self._image.camera
        self._limits = _limits_of(unified, self._options.visibility_margin + unified.deviation_px)
        self._settings = np.array(
            [
                self._options.visibility_rate,
                finite_number("delay", delay, minimum=0.0),
                self._options.max_linear_speed,
                self._options.max_angular_speed,
            ]
        )
        self._last = np.zeros(6)
        self.step(np.zeros((1, 3)), np.zeros((1, 2)), np.zeros(1, dtype=np.bool_), np.zeros(6))  # compiled

    def step(
        self,
        points: FloatArray,
        pixels: FloatArray,
        valid: BoolArray,
        wanted: FloatArray,
        delay: float | None = None,
        carried: FloatArray | None = None,
    ) -> FilteredTwist:
        """Return the twist nearest to ``wanted`` that keeps the points in view.

        Args:
            points: (n, 3) in the camera frame at the exposure, as estimated [m].
            pixels: (n, 2) as seen [px]; rows that are not ``valid`` may hold anything.
            valid: (n,) bool, the points seen.
            wanted: (6,) twist.
            delay: from this image's exposure until the twist acts [s], as measured; None: as stated.
            carried: (6,) the camera's mean twist for that time, as measured; None: the last twist.

        Raises:
            InputError: wrong shapes, a negative delay, or a number that is not finite where it counts.
        """
        command = finite_array("wanted", wanted, (6,))
        places = np.ascontiguousarray(finite_array("points", points, (None, 3)))
        image = np.ascontiguousarray(pixels, dtype=np.float64)
        used = np.ascontiguousarray(valid, dtype=np.bool_)
        if image.shape != (len(places), 2) or used.shape != (len(places),):
            raise InputError(
                f"pixels, valid: shapes {image.shape}, {used.shape} given; a row for each of the "
                f"{len(places)} points is needed"
            )
        image, used = self._image.kept(image, used)
        settings = self._settings.copy()
        if delay is not None:
            settings[_DELAY] = finite_number("delay", delay, minimum=0.0)
        twist, evidence = np.empty(6), np.empty(4)
        kernel.keep_in_view(
            self._image.camera.parameters,
            self._limits,
            settings,
            (places, image, used),
            self._last if carried is None else finite_array("carried", carried, (6,)),
            command,
            twist,
            evidence,
        )
        self._last = twist
        least, slack, active, solved = evidence.tolist()
        return FilteredTwist(twist.copy(), twist - command, least, max(slack, 0.0), int(active), solved > 0.0)


def _limits_of(camera: UnifiedCamera, margin: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the fields of the kernel's `Limits`, moved inward by the margin [px]."""
    scale = float(np.linalg.svd(camera.matrix[:2, :2], compute_uv=False)[-1])
    radius = math.sqrt(camera.parameters[SQUARE]) - margin / scale
    zone = (0.0, 0.0, -1.0)
    if camera.dead_zone is not None:
        zone = (*camera.dead_zone.center, camera.dead_zone.radius + margin)
    edge = margin - 0.5
    sides = (edge, camera.width - 1.0 - edge, edge, camera.height - 1.0 - edge)
    polygons = [outward_edges(polygon, margin) for polygon in camera.mask]
    edges = np.concatenate([*polygons, np.empty((0, 3))])
    ends = np.cumsum([len(p) for p in polygons], dtype=np.int64)
    return np.array([*sides, radius, scale, *zone]), edges, ends
