"""From the adjusted state to the calibration: checks, uncertainty, what a planner may trust."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.calibration.adjustment.calibration import Calibration, Coverage, Errors, Side, Status, failed
from omniservo.calibration.adjustment.equivalence import equivalents
from omniservo.calibration.adjustment.field_likelihood import likely_error
from omniservo.calibration.adjustment.held_out import HeldOut
from omniservo.calibration.adjustment.lens import (
    NAMES,
    angles_of,
    camera_of,
    field,
    physical_jacobian,
    to_physical,
)
from omniservo.calibration.adjustment.refine import State, linearise, residuals
from omniservo.calibration.adjustment.selection import Selection
from omniservo.calibration.adjustment.uncertainty import (
    fold_spread,
    jackknife_covariance,
    larger_covariance,
    pattern,
    pixel_bound,
    ray_deviation,
    theta_covariance,
)
from omniservo.calibration.adjustment.views import Views, flatness
from omniservo.calibration.outlines import inside_outlines
from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import BoolArray, FloatArray, owned

_ALIKE = math.radians(3.0)
"""targets whose planes differ by less are parallel: one plane's direction gives two of the numbers needed"""

_BEYOND = math.radians(3.0)
"""the camera is trusted at most this far past the outermost corner"""

_MOST_UNCERTAIN = math.radians(1.0)
_NINETY_NINE = 2.576
_KNOWN = 0.01
_LEAST_XI = 0.1
"""1% of ξ means 1% of at least this: at ξ = 0 no relative error exists"""


@dataclass(frozen=True, eq=False)
class Fit:
    """A model adjusted to the selected corners."""

    state: State
    free: BoolArray
    cost: float
    """[px²]"""
    converged: bool
    held_out: HeldOut | None
    reason: str
    """why this model and not the other"""


def conclude(
    selection: Selection,
    fit: Fit,
    size: tuple[int, int],
    starts: tuple[tuple[float, float, float], ...],
    lens: dict[str, Any],
) -> Calibration:
    """Return the calibration that the fit amounts to; its status says whether it may be trusted."""
    views, keep, state = selection.views, selection.keep, fit.state
    used = tuple(int(i) for i in views.numbers)
    freedom = 2.0 * keep.sum() - fit.free.sum() - 6.0 * views.count
    if freedom <= 0:
        message = "not_determined: fewer corners than unknowns"
        return failed("not_determined", message, selection.dropped, math.nan, used)
    variance = fit.cost / freedom
    normal = linearise(views, state, keep.astype(np.float64))
    covariance = theta_covariance(normal, fit.free, variance)
    points = state.points(views)
    largest = float(angles_of(points[keep]).max())
    turned = ray_deviation(state.theta, covariance, _angles(largest), turned=True)
    doubt = _doubt(views, points[keep], fit, size, turned)
    if doubt is not None:
        return failed(doubt[0], f"{doubt[0]}: {doubt[1]}", selection.dropped, math.nan, used)
    left_out = residuals(views, state) if fit.held_out is None else fit.held_out.residuals
    likely = likely_error(views, state, left_out, keep, size)
    off = theta_covariance(normal, fit.free, 1.0) @ likely.pulls.T
    covariance = covariance + off @ off.T
    if fit.held_out is not None:  # with fewer views leaving one out leaves no camera
        covariance = larger_covariance(covariance, jackknife_covariance(normal, fit.free), fit.free)
    limit, deviation, turned_px = _reach(selection, fit, size, covariance, largest)
    names = tuple(name for name, free in zip(NAMES, fit.free, strict=True) if free)
    J = physical_jacobian(state.theta)[np.ix_(fit.free, fit.free)]
    physical = J @ covariance[np.ix_(fit.free, fit.free)] @ J.T
    angles = _angles(limit)
    residual = residuals(views, state)
    rms = math.sqrt(fit.cost / keep.sum())
    kind: Literal["none", "radtan"] = "radtan" if fit.free.all() else "none"
    return Calibration(
        status="ok", message=_message(selection, rms, kind),
        camera=camera_of(state.theta, size, max_angle=limit, deviation_px=min(deviation, turned_px),
                         model_error=likely.error,
                         calibration_covariance=0.5 * (physical + physical.T), **lens),
        deviation_px=deviation, deviation_turned_px=turned_px, rms_px=rms,
        noise_px=math.sqrt(variance), views_used=used,
        views_dropped=selection.dropped, corners_dropped=selection.dropped_corners, distortion=kind,
        distortion_reason=fit.reason, parameter_names=names, covariance=owned(physical),
        identifiable=_identifiable(state.theta, covariance, physical, names, largest),
        equivalent=equivalents(state.theta, fit.free, field(state.theta, size, largest)),
        poses=_poses(views, state),
        residuals={n: owned(residual[views.rows(i)]) for i, n in enumerate(used)},
        held_out=None if fit.held_out is None else Errors(fit.held_out.px, fit.held_out.deg),
        ray_angles=owned(angles),
        ray_deviation_deg=_degrees(state, covariance, angles, turned=False),
        ray_deviation_turned_deg=_degrees(state, covariance, angles, turned=True),
        coverage=Coverage(_covered(views, keep, size), largest), starts=starts,
        seen_from=_seen_from(views, state), seconds=math.nan,
    )  # fmt: skip


def _doubt(
    views: Views, points: FloatArray, fit: Fit, size: tuple[int, int], deviation: FloatArray
) -> tuple[Status, str] | None:
    """Return the status and its reason where the fit is no camera to trust, else None."""
    tilt = _largest_tilt(views, fit.state)
    if tilt < _ALIKE:
        return "views_alike", (
            f"all {views.count} targets are parallel within {math.degrees(tilt):.2g}°, which does not "
            "determine a camera; tilt the target by 20° and more, in different directions"
        )
    if not fit.converged or not np.isfinite(fit.state.theta).all():
        return "not_converged", "the adjustment found no minimum; more views, tilted differently, are needed"
    _, seen = camera_of(fit.state.theta, size).project(points)
    if not seen.all():
        return "not_converged", (
            f"{int((~seen).sum())} corners lie outside the domain of the camera that fits them best: its "
            'model folds within the image; with distortion="radtan" try "none"'
        )
    if 2.0 * deviation.max() > _MOST_UNCERTAIN:
        worst = math.degrees(2.0 * float(deviation.max()))
        return "not_determined", (
            f"rays would be uncertain by {worst:.2g}° (95%); more views, tilted "
            "differently and over more of the image, are needed"
        )
    return None


def _reach(
    selection: Selection, fit: Fit, size: tuple[int, int], covariance: FloatArray, largest: float
) -> tuple[float, float, float]:
    """Return the angle to which the camera is trusted [rad] and how far its pixels may be off there [px].

    The last number is what is left of that after a rotation of the camera's frame. The 3° past the outermost
    corner are granted where they do not double the bound.
    """
    usable = camera_of(fit.state.theta, size).usable_angle
    left = pattern(selection.views, fit.state, selection.keep)
    inner, outer = min(largest, usable), min(largest + _BEYOND, usable)
    bounds = {limit: _bound(fit, size, covariance, limit, turned=False) + left for limit in (inner, outer)}
    limit = outer if bounds[outer] <= 2.0 * bounds[inner] else inner
    return limit, bounds[limit], _bound(fit, size, covariance, limit, turned=True) + left


def _bound(fit: Fit, size: tuple[int, int], covariance: FloatArray, limit: float, *, turned: bool) -> float:
    """Return the larger of the covariance's 95% bound and twice the spread of the folds' cameras [px]."""
    theta = fit.state.theta
    rays = field(theta, size, limit)
    bound = pixel_bound(theta, covariance, rays, turned=turned)
    if fit.held_out is None:
        return bound
    return max(bound, 2.0 * fold_spread(fit.held_out.cameras, rays, turned=turned))


def _identifiable(
    theta: FloatArray, covariance: FloatArray, physical: FloatArray, names: tuple[str, ...], largest: float
) -> dict[str, bool]:
    """Return whether each parameter's 99% interval is within 1%.

    Of its size (fx, fy, ξ), of the pixels per radian (cx, cy), and for the distortion of a pixel's
    distance from
    the centre at the outermost corner, which scales with r² (k1), r⁴ (k2) and r (p1, p2).
    """
    values = dict(zip(NAMES, to_physical(theta), strict=True))
    std = dict(zip(names, np.sqrt(np.diag(physical)), strict=True))
    xi = values["xi"]
    r = math.sin(largest) / max(math.cos(largest) + xi, 1e-3)
    if xi > 1.0:
        r = min(r, 1.0 / math.sqrt(xi * xi - 1.0))
    scale = float(np.abs(theta[:2]).mean())
    unit = {
        "fx": abs(values["fx"]), "fy": abs(values["fy"]), "cx": scale, "cy": scale, "xi": max(xi, _LEAST_XI),
        "k1": 1.0 / r**2, "k2": 1.0 / r**4, "p1": 1.0 / r, "p2": 1.0 / r,
    }  # fmt: skip
    return {name: bool(_NINETY_NINE * std[name] <= _KNOWN * unit[name]) for name in names}


def _largest_tilt(views: Views, state: State) -> float:
    """Return the largest angle between the planes of two targets [rad]; π where one is not planar."""
    flat = [flatness(views.points[views.rows(i)]) for i in range(views.count)]
    if not all(planar for _, _, planar in flat):
        return math.pi
    normals = (state.rotations @ np.stack([axes[:, 2] for _, axes, _ in flat])[:, :, None])[:, :, 0]
    cosines = np.abs(normals @ normals.T)
    return float(np.arccos(np.clip(cosines, 0.0, 1.0)).max())


def _seen_from(views: Views, state: State) -> Side:
    sides = set()
    for i in range(views.count):
        centre, axes, planar = flatness(views.points[views.rows(i)])
        if not planar:
            return "solid"
        towards = state.rotations[i] @ axes[:, 2] @ (state.rotations[i] @ centre + state.translations[i])
        sides.add("-z" if towards > 0.0 else "+z")
    return "both" if len(sides) == 2 else "-z" if "-z" in sides else "+z"


def _covered(views: Views, keep: BoolArray, size: tuple[int, int]) -> float:
    """Return the part of the image inside at least one view's outline."""
    rows = (views.rows(i) for i in range(views.count))
    return float(inside_outlines((views.pixels[r][keep[r]] for r in rows), size).mean())


def _poses(views: Views, state: State) -> dict[int, RigidTransform]:
    turns = Rotation.from_matrix(state.rotations)
    return {
        int(number): RigidTransform.from_components(state.translations[i], turns[i])
        for i, number in enumerate(views.numbers)
    }


def _message(selection: Selection, rms: float, kind: str) -> str:
    corners = int(selection.keep.sum())
    model = "with radial-tangential distortion" if kind == "radtan" else "without distortion"
    return (
        f"unified camera {model} from {corners} corners in {selection.views.count} views, {rms:.3g} px rms; "
        f"{len(selection.dropped)} views and {int((~selection.keep).sum())} corners not used"
    )


def _degrees(state: State, covariance: FloatArray, angles: FloatArray, *, turned: bool) -> FloatArray:
    return np.degrees(ray_deviation(state.theta, covariance, angles, turned=turned))


def _angles(limit: float) -> FloatArray:
    return np.linspace(0.0, limit * (1.0 - 1e-6), 33)


def lens_of(camera: UnifiedCamera | None) -> dict[str, Any]:
    """Return what a given camera knows beyond its parameters: dead zone and mask."""
    return {} if camera is None else {"dead_zone": camera.dead_zone, "mask": camera.mask}
