"""How far a camera lies from the one that it stands for, over the field that is used."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.cameras.domain_warnings import image_grid
from omniservo.cameras.models.central_model import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray

_GRID = 121
"""pixels along each side of the image"""

_ROUND = 720
"""directions round the domain's border"""

_WORST = 16
_FINER = 9

_HIGH, _CLIMBS = 0.8, 6
_AROUND = np.array([[u, v] for u in (-1.0, 0.0, 1.0) for v in (-1.0, 0.0, 1.0) if u or v])


@dataclass(frozen=True, eq=False)
class Residual:
    """Where the pixels and rays of a camera differ from those of another, as numbers and as a map.

    The map holds pixels that the other camera uses: a grid with the image's border, the border of the
    domain, and a finer grid round the largest residuals.
    """

    largest_px: float
    """Largest distance between a pixel and where its ray is projected to [px]."""
    rms_px: float
    """[px]"""
    largest_rad: float
    """Largest angle between the two rays of a pixel [rad]."""
    pixels: FloatArray
    """(n, 2) [px]"""
    px: FloatArray
    """(n,) [px]; NaN where the ray is outside the camera's domain"""
    rad: FloatArray
    """(n,) [rad]; NaN where the pixel is outside the camera's domain"""
    lost: float
    """The share of the field whose rays the camera cannot project, 0 to 1."""

    def __str__(self) -> str:
        lost = f", {100.0 * self.lost:.2g}% of the field lost" if self.lost > 0.0 else ""
        return (
            f"at most {self.largest_px:.3g} px ({math.degrees(self.largest_rad):.3g} deg) away,"
            f" rms {self.rms_px:.3g} px{lost}"
        )


def used_pixels(model: CentralModel, steps: int = _GRID) -> FloatArray:
    """Return pixels (n, 2) of the field that is used: in the image and valid, with both borders.

    A grid of ``steps`` pixels along each side, and where the domain ends inside the image its border.
    """
    pixels = image_grid(model, steps)
    return np.vstack([pixels[_is_used(model, pixels)], rim_pixels(model)])


def rim_pixels(model: CentralModel, most: float = math.pi) -> FloatArray:
    """Return where the border of the domain, up to an angle [rad], lies inside the image, (n, 2) [px]."""
    angle = min(model.usable_angle, most, math.pi - 1e-6) * (1.0 - 1e-9)
    around = np.linspace(0.0, 2.0 * math.pi, _ROUND, endpoint=False)
    sine = math.sin(angle)
    rays = np.column_stack([sine * np.cos(around), sine * np.sin(around), np.full(_ROUND, math.cos(angle))])
    pixels = model.project(rays)[0]
    return np.asarray(pixels[_is_used(model, pixels)])


def measured(camera: CentralModel, model: CentralModel) -> Residual:
    """Return the residual of ``camera`` as a stand-in for ``model``."""
    pixels = used_pixels(model)
    if camera.usable_angle < model.usable_angle:
        pixels = np.vstack([pixels, rim_pixels(model, camera.usable_angle)])
    px, rad = _differences(camera, model, pixels)
    worst = pixels[np.argsort(np.nan_to_num(px))[-_WORST:]]
    step = np.array([model.width, model.height]) / (_GRID - 1.0)
    offsets = np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, _FINER)] * 2), axis=-1).reshape(-1, 2) * step
    finer = (worst[:, None] + offsets).reshape(-1, 2)
    finer = finer[_is_used(model, finer)]
    more_px, more_rad = _differences(camera, model, finer)
    pixels, px, rad = np.vstack([pixels, finer]), np.append(px, more_px), np.append(rad, more_rad)
    top = _climbed(camera, model, pixels, px, step)
    more_px, more_rad = _differences(camera, model, top)
    pixels, px, rad = np.vstack([pixels, top]), np.append(px, more_px), np.append(rad, more_rad)
    largest = [float(np.nanmax(d)) if np.isfinite(d).any() else math.inf for d in (px, rad)]
    rms = math.sqrt(float(np.nanmean(px**2))) if np.isfinite(px).any() else math.inf
    field = image_grid(model, _GRID)
    rays = model.unproject(field[_is_used(model, field)])[0]
    lost = 1.0 - float(camera.project(rays)[1].mean())
    return Residual(largest[0], rms, largest[1], pixels, px, rad, lost)


def _climbed(
    camera: CentralModel, model: CentralModel, pixels: FloatArray, px: FloatArray, step: FloatArray
) -> FloatArray:
    """Return the pixel (1, 2) with the largest residual near those with nearly so large ones.

    A narrow ridge, or what a rim and the image's edge enclose, lies between the grid's pixels: all that are
    high climb to the best of eight neighbours, over steps that halve.
    """
    least = _HIGH * np.nanmax(px) if np.isfinite(px).any() else math.inf
    at, height = (rows[np.nan_to_num(px) >= least] for rows in (pixels, px))
    for k in range(_CLIMBS):
        near = (at[:, None] + _AROUND * step * 0.5 ** (k + 1)).reshape(-1, 2)
        reached = np.zeros(len(near))
        used = _is_used(model, near)
        reached[used] = np.nan_to_num(_differences(camera, model, near[used])[0])
        best = len(_AROUND) * np.arange(len(at)) + reached.reshape(-1, len(_AROUND)).argmax(axis=1)
        higher = reached[best] > height
        at, height = np.where(higher[:, None], near[best], at), np.maximum(reached[best], height)
    return at[np.argsort(height)[-1:]]


def exact(model: CentralModel) -> Residual:
    """Return the residual of an exact equivalence: 0 everywhere."""
    pixels = used_pixels(model)
    zero = np.zeros(len(pixels))
    return Residual(0.0, 0.0, 0.0, pixels, zero, zero, 0.0)


def _is_used(model: CentralModel, pixels: FloatArray) -> BoolArray:
    return np.asarray(model.in_image(pixels) & model.unproject(pixels)[1], dtype=np.bool_)


def _differences(
    camera: CentralModel, model: CentralModel, pixels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    rays = model.unproject(pixels)[0]
    px = np.hypot(*(camera.project(rays)[0] - pixels).T)
    others = camera.unproject(pixels)[0]
    across = np.linalg.norm(np.cross(rays, others), axis=1)
    return px, np.arctan2(across, np.einsum("ij,ij->i", rays, others))
