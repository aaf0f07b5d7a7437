"""What a camera sees, drawn: its field, its limits, and how many pixels a degree gets where."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patheffects import Normal, Stroke

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.reporting.style import (
    CERTIFIED,
    EXECUTED,
    FORBIDDEN,
    PLANNED,
    QUIET,
    REQUIRED,
    Drawing,
    as_image,
    legend_below,
    new_axes,
    styled,
)

_CELLS = 240
"""of the density map, along the longer side"""
_TURNS = np.radians(np.arange(0.0, 360.0, 5.0))
_DEGREE = math.pi / 180.0


def draw_field(camera: CentralModel, unified: UnifiedCamera | None) -> list[Drawing]:
    """Return the camera's field over its image, and its pixels a degree against the angle from the axis.

    ``unified``: the camera that plans are made with, whose polygon is drawn; None: there is none.
    """
    with styled():
        return [_over_the_image(camera, unified), _against_the_angle(camera)]


def pixel_density(camera: CentralModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return u (c+1,), v (r+1,) of a grid over the image [px], and the density in its cells (r, c) [px/deg].

    The density is √(pixels a square degree): cell area over the solid angle it sees. NaN where a corner of
    the cell is not usable.
    """
    step = max(camera.width, camera.height) / _CELLS
    u = np.linspace(-0.5, camera.width - 0.5, max(2, round(camera.width / step)) + 1)
    v = np.linspace(-0.5, camera.height - 0.5, max(2, round(camera.height / step)) + 1)
    s, valid = _seen(camera, np.stack(np.meshgrid(u, v), axis=-1))
    s = np.where(valid[..., None], s, np.nan)
    across = np.cross(s[1:, 1:] - s[:-1, :-1], s[1:, :-1] - s[:-1, 1:])
    solid_angle = 0.5 * np.linalg.norm(across, axis=-1)
    area = (u[1] - u[0]) * (v[1] - v[0])
    return u, v, np.sqrt(area / solid_angle) * _DEGREE


def past_right_angle(camera: CentralModel) -> float:
    """Return how much of the image's usable part sees past 90° from the axis, which no plane Z = 1 shows.

    Measured at the middles of a grid's cells; 0 where the image has no usable part.
    """
    step = max(camera.width, camera.height) / _CELLS
    u, v = np.arange(0.0, camera.width, step), np.arange(0.0, camera.height, step)
    bearings, valid = _seen(camera, np.stack(np.meshgrid(u, v), axis=-1))
    return float((bearings[valid][:, 2] <= 0.0).mean()) if valid.any() else 0.0


def _seen(camera: CentralModel, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
    bearings, valid = camera.unproject(pixels)
    return bearings, valid & camera.in_image(np.where(valid[..., None], pixels, 0.0))


def _over_the_image(camera: CentralModel, unified: UnifiedCamera | None) -> Drawing:
    figure, axes = new_axes(7.4, 1.3 + 5.4 * camera.height / camera.width)
    axes.set_facecolor(FORBIDDEN)
    u, v, density = pixel_density(camera)
    mesh = axes.pcolormesh(u, v, density, cmap="viridis", shading="flat", rasterized=True)
    figure.colorbar(mesh, ax=axes, label="pixels a degree [px/deg]", shrink=0.85, pad=0.015)
    _rings(axes, camera, u, v)
    _limits(axes, camera)
    _polygon(axes, unified)
    _model_error(axes, camera)
    as_image(axes, camera.width, camera.height)
    legend_below(figure, axes, 4)
    caption = (
        "White: angles from the axis; thick, with a dark border: 90°. Tinted: what is no usable part of "
        "the image. Hatched: seen past 90°, which the virtual plane Z = 1 loses."
    )
    return Drawing("camera-field", "What the camera sees", caption, figure)


def _model_error(axes: Axes, camera: CentralModel) -> None:
    """Draw the length over which the model's error is alike, as a disc in the middle of the image."""
    error = camera.model_error
    if error is None or error.sigma_px == 0.0:
        return
    middle = 0.5 * camera.width, 0.5 * camera.height
    said = f"model off by {error.sigma_px:.2g} px (1σ), alike over this length"
    axes.add_patch(Circle(middle, error.length_px, fill=False, ec=QUIET, lw=1.2, ls=":", label=said))


def _rings(axes: Axes, camera: CentralModel, u: FloatArray, v: FloatArray) -> None:
    """Draw angles from the axis, and hatch what lies past 90°."""
    bearings, valid = _seen(camera, np.stack(np.meshgrid(u, v), axis=-1))
    if not valid.any():
        return
    angles = np.where(valid, np.degrees(np.arccos(np.clip(bearings[..., 2], -1.0, 1.0))), np.nan)
    largest = np.nanmax(angles)
    step = 30.0 if largest > 65.0 else 10.0
    levels = [level for level in np.arange(step, largest, step) if level != 90.0]
    if levels:
        lines = axes.contour(u, v, angles, levels=levels, colors="white", linewidths=0.9)
        near = [_above(camera, math.radians(level)) for level in levels]
        for text in axes.clabel(lines, fmt="%.0f°", fontsize=8, manual=[p for p in near if p is not None]):
            text.set_path_effects([Stroke(linewidth=2.0, foreground=REQUIRED), Normal()])
        lines.set_path_effects([Stroke(linewidth=1.7, foreground=REQUIRED), Normal()])
    if largest > 90.0:
        lines = axes.contour(u, v, angles, levels=[90.0], colors="white", linewidths=2.2)
        lines.set_path_effects([Stroke(linewidth=3.8, foreground=REQUIRED), Normal()])
        axes.contourf(u, v, angles, levels=[90.0, 181.0], colors="none", hatches=["///"])
        axes.fill([], [], fc="none", ec="black", lw=0.0, hatch="///", label="past 90°")


def _above(camera: CentralModel, angle: float) -> tuple[float, float] | None:
    """Return the topmost pixel at an angle from the axis that has room for a label; None: none is shown."""
    ring = _circle(camera, angle)
    shown = ring[camera.in_image(np.nan_to_num(ring, nan=-1e6))]
    if not len(shown):
        return None
    border = np.minimum(shown, [camera.width, camera.height] - shown).min(axis=1)
    shown = shown[border >= min(0.05 * camera.width, border.max())]
    u, v = shown[np.argmin(shown[:, 1])]
    return float(u), float(v)


def _limits(axes: Axes, camera: CentralModel) -> None:
    """Draw the image's border, the lens's circle, dead zone and mask."""
    w, h = camera.width, camera.height
    axes.add_patch(Rectangle((-0.5, -0.5), w, h, fill=False, ec=REQUIRED, lw=1.4, label="image"))
    rim = _circle(camera, camera.usable_angle * (1.0 - 1e-9))
    if camera.in_image(np.nan_to_num(rim, nan=-1e6)).any():
        label = f"usable to {math.degrees(camera.usable_angle):.1f}°"
        axes.plot(*rim.T, color=PLANNED, lw=1.6, label=label)
    if camera.dead_zone is not None:
        zone = camera.dead_zone
        axes.add_patch(Circle(zone.center, zone.radius, fc=FORBIDDEN, ec=EXECUTED, lw=1.6, label="dead zone"))
    for i, corners in enumerate(camera.mask):
        label = "_mask" if i else "mask"
        axes.add_patch(Polygon(corners, closed=True, fc=FORBIDDEN, ec=QUIET, lw=1.2, label=label))


def _polygon(axes: Axes, unified: UnifiedCamera | None) -> None:
    """Draw what plans keep to where it is not the image's border."""
    polygon = None if unified is None else unified.image_limits().polygon
    if unified is not None and polygon is not None:
        border = _polygon_in_image(unified, polygon)
        axes.plot(*border.T, color=CERTIFIED, lw=1.6, ls="--", label="plans keep to")


def _circle(camera: CentralModel, angle: float) -> FloatArray:
    """Return the pixels (k, 2) at an angle from the axis; NaN where there are none."""
    turns = np.linspace(0.0, 2.0 * math.pi, 721)
    across = math.sin(angle)
    rays = np.stack([across * np.cos(turns), across * np.sin(turns), np.full(721, math.cos(angle))], axis=-1)
    return camera.project(rays)[0]


def _polygon_in_image(camera: UnifiedCamera, polygon: FloatArray) -> FloatArray:
    """Return where the border of a polygon on the undistorted plane lies in the image (k, 2)."""
    straight = UnifiedCamera.from_dict(camera.to_dict() | {"distortion": [0.0] * 4})
    t = np.linspace(0.0, 1.0, 33)[:, None]
    corners = np.vstack([polygon, polygon[:1]])
    edges = [a + t * (b - a) for a, b in pairwise(corners)]
    m = np.vstack(edges)
    pixels = m @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]
    return camera.project(straight.unproject(pixels)[0])[0]


def _against_the_angle(camera: CentralModel) -> Drawing:
    figure, axes = new_axes(6.4, 3.6)
    angles = np.linspace(0.002, camera.usable_angle * 0.9999, 400)
    looks = (EXECUTED, "-", "away from the axis"), (PLANNED, "--", "round it")
    for values, (color, dashes, label) in zip(_pixels_a_degree(camera, angles), looks, strict=True):
        seen = np.isfinite(values).any(axis=1)
        x, rows = np.degrees(angles[seen]), values[seen]
        axes.fill_between(x, np.nanmin(rows, axis=1), np.nanmax(rows, axis=1), color=color, alpha=0.25, lw=0)
        axes.plot(x, np.nanmedian(rows, axis=1), color=color, ls=dashes, label=label)
    if camera.usable_angle > 0.5 * math.pi:
        axes.axvline(90.0, color=REQUIRED, ls=":", lw=1.4, label="90°: no plane Z = 1 beyond")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("angle from the axis [deg]")
    axes.set_ylabel("pixels a degree [px/deg]")
    legend_below(figure, axes, 3)
    caption = "Lines: the median over all directions that the image shows; bands: smallest to largest."
    return Drawing("camera-density", "Pixels a degree against the angle from the axis", caption, figure)


def _pixels_a_degree(camera: CentralModel, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ∂p/∂θ and ∂p/∂ψ/sin θ (k, turns) [px/deg] at angles θ (k,); NaN outside the image."""
    h = 1e-5
    theta, turn = np.meshgrid(angles, _TURNS, indexing="ij")

    def pixels(theta: FloatArray, turn: FloatArray) -> FloatArray:
        x, y = np.sin(theta) * np.cos(turn), np.sin(theta) * np.sin(turn)
        return camera.project(np.stack([x, y, np.cos(theta)], axis=-1))[0]

    here = pixels(theta, turn)
    inside = camera.in_image(np.nan_to_num(here, nan=-1e6))
    along = np.linalg.norm(pixels(theta + h, turn) - pixels(theta - h, turn), axis=-1) / (2.0 * h)
    round_it = np.linalg.norm(pixels(theta, turn + h) - pixels(theta, turn - h), axis=-1) / (2.0 * h)
    around = round_it / np.sin(theta)
    return np.where(inside, along * _DEGREE, np.nan), np.where(inside, around * _DEGREE, np.nan)
