"""Margins in px of a distorted camera: every margin has a polygon of its own, so it is bisected."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np

from omniservo.cameras import ImageLimits, UnifiedCamera
from omniservo.cameras.distorted_mask import mask_on_plane
from omniservo.cameras.image_mask import distance_beyond
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.subdivision import PROVEN, REFUTED, UNDECIDED
from omniservo.planning.bernstein_path import camera_controls, camera_count
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certificate.certificate import UNSEEN_PX, ConstraintMargin
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.image_mask import prove_outside_masks
from omniservo.planning.constraints.visibility import prove_visible
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_arrays import constraints_of

LOOKS = 256
"""The path is checked so many times, evenly."""

_POLYGON = "visibility polygon"
_MASK = "visibility mask "

FINE_PX = 0.2
"""A margin is bisected until it is known so closely."""

_STEP_PX = 0.5 * FINE_PX
"""Limits are moved inward by whole multiples of it: paths of one camera share their polygons, each of which
takes longer than the proof of a path."""


def distorted_margins(
    problem: PlanningProblem, constraints: Constraints, rotation: FloatArray, translation: FloatArray
) -> tuple[list[ConstraintMargin], list[int], FloatArray | None]:
    """Return the margins "visibility polygon", "dead_zone" and of masks, their statuses, and the polygon.

    The polygon lies inside the region that the image shows, so a margin is not as large as the truth
    allows where the path uses what the polygon leaves out; what only the polygon forbids is UNDECIDED.
    """
    controls = camera_controls(rotation, translation, constraints.points)
    count = float(camera_count(rotation.shape[1] - 1, translation.shape[1] - 1))
    margin_px, found, statuses, polygon = problem.image_margin, [], [], None
    for name, seen in _seen_margins(problem, CameraPath(rotation, translation)):

        def proven(moved: float, name: str = name) -> ImageLimits | None:
            try:
                limits = _limits_of(problem, name, moved)
            except InputError:
                return None
            kept = constraints_of(problem, limits)
            if name.startswith(_MASK):
                edges, firsts = kept.mask_edges, kept.mask_firsts
                return limits if prove_outside_masks(*controls, count, edges, firsts)[0] == PROVEN else None
            only_zone = name == "dead_zone"
            rows = kept.limits[:0] if only_zone else kept.limits
            disc = kept.disc if only_zone else np.zeros(0)
            return limits if prove_visible(*controls, count, rows, disc)[0] == PROVEN else None

        least, w, point = seen
        moved, limits = _largest(proven, margin_px, margin_px + max(0.0, least))
        status = UNDECIDED if limits is None else PROVEN
        if least < -1e-6:
            status = REFUTED
        found.append(
            ConstraintMargin(f"{name} (point {point})", moved - margin_px if limits else least, "px", w)
        )
        statuses.append(status)
        if name == _POLYGON:
            polygon = limits.polygon if limits else problem.camera.image_limits(margin_px).polygon
    return found, statuses, polygon


def _limits_of(problem: PlanningProblem, name: str, margin_px: float) -> ImageLimits:
    """Return the limits moved inward by a margin; of a mask alone, where the path keeps to the polygon."""
    camera = problem.camera
    if not name.startswith(_MASK):
        return _limits_at(camera, margin_px)
    kept = camera.image_limits(problem.image_margin)
    region = np.zeros((0, 2)) if kept.polygon is None else kept.polygon
    cover = mask_on_plane(camera, camera.mask[int(name.removeprefix(_MASK))], margin_px, region)
    return replace(kept, mask=() if cover is None else (cover,))


@lru_cache(maxsize=2048)
def _limits_at(camera: UnifiedCamera, margin_px: float) -> ImageLimits:
    """Return the camera's limits moved inward, of as many margins as its paths may have."""
    return camera.image_limits(margin_px)


def _largest(
    proven: Callable[[float], ImageLimits | None], low: float, high: float
) -> tuple[float, ImageLimits | None]:
    """Return by how much limits can be moved inward and are proven, up to FINE_PX, and these limits.

    None where even ``low`` is not; ``high`` is seen to be the most.
    """
    limits = proven(low)
    if limits is None:
        return low, None
    width = _STEP_PX
    while high - low > FINE_PX:
        middle = _STEP_PX * round(max(0.5 * (low + high), high - width) / _STEP_PX)
        width *= 4.0
        better = proven(middle)
        if better is None:
            high = middle
        else:
            low, limits = middle, better
    return low, limits


def _seen_margins(problem: PlanningProblem, path: CameraPath) -> list[tuple[str, tuple[float, float, int]]]:
    """Return (name, (smallest margin seen, w, point)) of border, dead zone and masks [px]."""
    camera = problem.camera
    w = np.linspace(0.0, 1.0, LOOKS + 1)
    poses = path(w)
    offsets = problem.points[None] - poses.translation[:, None]
    camera_points = np.einsum("kij,kni->knj", poses.rotation.as_matrix(), offsets)
    pixels, valid = camera.project(camera_points)
    size = np.array([camera.width, camera.height])
    border = np.minimum(pixels + 0.5, size - 0.5 - pixels).min(axis=-1)
    border = np.where(valid, border, -math.inf)
    seen = [(_POLYGON, border)]
    if camera.dead_zone is not None:
        away = np.linalg.norm(pixels - np.array(camera.dead_zone.center), axis=-1) - camera.dead_zone.radius
        seen.append(("dead_zone", np.where(valid, away, math.inf)))
    for i, corners in enumerate(camera.mask):
        away = distance_beyond((corners,), pixels)
        seen.append((f"{_MASK}{i}", np.where(valid, away, math.inf)))
    result = []
    for name, values in seen:
        step, point = np.unravel_index(int(np.argmin(values)), values.shape)
        left = float(values[step, point]) - problem.image_margin
        smallest = (
            max(UNSEEN_PX, left) if left < math.inf else 0.0
        )  # no pixel at all: nothing is seen to be left
        result.append((name, (smallest, float(w[step]), int(point))))
    return result
