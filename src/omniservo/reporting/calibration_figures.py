"""What a calibration rests on, drawn: where corners were seen, what is left, how sure the rays are."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from omniservo.calibration.calibrate_images import ImageCalibration
from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.spelling import first_digit
from omniservo.reporting.style import (
    CERTIFIED,
    EXECUTED,
    PLANNED,
    QUIET,
    REQUIRED,
    Drawing,
    as_image,
    legend_below,
    new_axes,
    styled,
)

_ARROW = 0.06
"""length of the largest arrow, part of the image's width"""
_BANDS = 14
"""of the angle, in which errors are summed up"""


def calibration_drawings(result: ImageCalibration) -> Iterator[Drawing]:
    """Yield the figures of a calibration; none where there is no camera."""
    if result.calibration.camera is None:
        return
    for draw in (_corners, _residuals, _against_angle, _rays, _views):
        with styled():
            yield draw(result)


def view_residuals(result: ImageCalibration) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Return image → (corners (k, 2), projection − corner (k, 2)) [px], of the views that are used."""
    found = result.calibration.residuals
    return {
        result.calibrated[k]: (np.asarray(result.views[result.calibrated[k]].pixels), residual)
        for k, residual in sorted(found.items())
    }


def _corners(result: ImageCalibration) -> Drawing:
    figure, axes = _image_axes(result)
    seen = view_residuals(result)
    for i, view in enumerate(result.views):
        if view.found and i not in seen:
            axes.plot(*np.asarray(view.pixels).T, "x", color=CERTIFIED, ms=4, label="_")
    for corners, _ in seen.values():
        axes.plot(*corners.T, ".", ms=4, alpha=0.8)
    if any(view.found and i not in seen for i, view in enumerate(result.views)):
        axes.plot([], [], "x", color=CERTIFIED, label="corners of views that are not used")
        legend_below(figure, axes, 1)
    covered = 100.0 * result.calibration.coverage.image_fraction
    angle = np.degrees(result.calibration.coverage.largest_angle)
    caption = (
        f"A colour for each view. They cover {covered:.0f}% of the image, to {angle:.1f}° from the axis."
    )
    return Drawing("corners", "Where corners were seen", caption, figure)


def _residuals(result: ImageCalibration) -> Drawing:
    figure, axes = _image_axes(result)
    corners, left = (np.vstack(rows) for rows in zip(*view_residuals(result).values(), strict=True))
    lengths = np.hypot(*left.T)
    scale = first_digit(_ARROW * result.size[0] / max(float(np.quantile(lengths, 0.99)), 1e-9))
    shown = lengths <= np.quantile(lengths, 0.99) * 1.5
    arrows = scale * left[shown]
    axes.quiver(*corners[shown].T, *arrows.T, angles="xy", scale_units="xy", scale=1.0, width=0.0016,
                color=EXECUTED)  # fmt: skip
    axes.plot(*corners[~shown].T, "x", color=CERTIFIED, ms=5, label="longer than drawn")
    if not shown.all():
        legend_below(figure, axes, 1)
    caption = (
        f"Projection minus corner, {scale:g} times as long. "
        "Arrows that agree in a place show what the model lacks."
    )
    return Drawing("residuals", "What is left over the image", caption, figure)


def _against_angle(result: ImageCalibration) -> Drawing:
    figure, axes = new_axes(6.4, 4.0)
    corners, left = (np.vstack(rows) for rows in zip(*view_residuals(result).values(), strict=True))
    angles, lengths = _angles(result, corners), np.hypot(*left.T)
    angles, lengths = angles[np.isfinite(angles)], lengths[np.isfinite(angles)]
    axes.plot(angles, lengths, ".", color=QUIET, ms=3, alpha=0.6, label="corners")
    edges = np.linspace(0.0, float(angles.max()), _BANDS + 1)
    middles, rms = [], []
    for low, high in pairwise(edges):
        inside = (angles >= low) & (angles <= high)
        if inside.sum() >= 5:
            middles.append(0.5 * (low + high))
            rms.append(float(np.sqrt(np.mean(lengths[inside] ** 2))))
    axes.plot(middles, rms, "o-", color=EXECUTED, ms=4, label="root mean square")
    axes.axvline(90.0, color=REQUIRED, ls=":", lw=1.4) if angles.max() > 90.0 else None
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 1.05 * float(np.quantile(lengths, 0.995)))
    axes.set_xlabel("angle from the axis [deg]")
    axes.set_ylabel("projection − corner [px]")
    legend_below(figure, axes, 2)
    caption = (
        "A model that fits leaves as much at the rim as in the middle. The largest half percent is cut off."
    )
    return Drawing("error-against-angle", "What is left against the angle from the axis", caption, figure)


def _angles(result: ImageCalibration, corners: FloatArray) -> FloatArray:
    """Return the angles from the axis [deg] of corners (k, 2); NaN where the camera does not see them."""
    camera = result.calibration.camera
    if camera is None:
        return np.full(len(corners), np.nan)
    rays = camera.unproject(corners)[0]
    return np.asarray(np.degrees(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])))


def _rays(result: ImageCalibration) -> Drawing:
    figure, axes = new_axes(6.4, 4.0)
    found = result.calibration
    angles = np.degrees(found.ray_angles)
    axes.plot(angles, found.ray_deviation_deg, color=EXECUTED, label="of a ray")
    axes.plot(
        angles,
        found.ray_deviation_turned_deg,
        color=PLANNED,
        ls="--",
        label="after the best rotation of the frame",
    )
    corners = np.degrees(found.coverage.largest_angle)
    axes.axvline(corners, color=REQUIRED, ls=":", lw=1.4, label="outermost corner")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("angle from the axis [deg]")
    axes.set_ylabel("standard deviation [deg]")
    legend_below(figure, axes, 3)
    caption = "From the noise of the corners alone. A rotation of the whole frame is absorbed by the poses."
    return Drawing("ray-uncertainty", "How sure the rays are", caption, figure)


def _views(result: ImageCalibration) -> Drawing:
    seen = view_residuals(result)
    figure, axes = new_axes(max(6.4, 1.2 + 0.22 * len(seen)), 3.8)
    rms = [float(np.sqrt(np.mean(np.sum(left**2, axis=1)))) for _, left in seen.values()]
    places = np.arange(len(rms))
    axes.bar(places, rms, color=EXECUTED, width=0.75)
    axes.axhline(result.calibration.rms_px, color=PLANNED, ls="--", label="all views")
    axes.set_xticks(places, [result.images[i].stem for i in seen], rotation=60, ha="right", fontsize=8)
    axes.grid(visible=False, axis="x")
    axes.set_ylabel("root mean square [px]")
    legend_below(figure, axes, 1)
    return Drawing("views", "What is left in each view", "Corners that are not used are included.", figure)


def _image_axes(result: ImageCalibration) -> tuple[Figure, Axes]:
    width, height = result.size
    figure, axes = new_axes(6.4, 1.0 + 5.6 * height / width)
    axes.add_patch(Rectangle((-0.5, -0.5), width, height, fill=False, ec=REQUIRED, lw=1.2))
    as_image(axes, width, height)
    return figure, axes
