"""Patches of one image laid on another, affinely, with gain and offset, to hundredths of a pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.perception.patch_kernels import FloatImage, normalise, write_pulls, write_templates
from omniservo.perception.tangent_patches import TangentFrames, grid, sample

_RIDGE = 1e-6
"""of the largest diagonal term of the normal equations"""
_END = 0.003
"""[samples] a step smaller than this is the last"""
LEAST_NORM = 1.0
"""[grey values] of a patch that is not flat"""
WINDOW = 0.55
"""[half sides of a patch] standard deviation of the Gaussian weights of its samples"""
_LARGEST_TURN = 0.3
"""of the patch in one step: none turns it inside out"""
_LONGEST_STEP = 2.0
"""[samples] of the patch's middle; farther, the gradient says nothing"""


@dataclass(frozen=True, eq=False)
class Templates:
    """Patches (n) to be found again: k = (2·half + 1)² samples each, on tangent planes."""

    frames: TangentFrames
    pitch: FloatArray
    """(n,) [rad] between samples, at the patch's middle"""
    half: int
    grey: FloatArray
    """(n, k) of weighted mean 0 and weighted norm 1; 0 where the patch is flat"""
    steepest: FloatArray
    """(n, k, 6) derivative of the grey by the affine parameters (a, b, c, d, x, y), [1/sample] for x and y,
    without what gain and offset absorb"""
    normal: FloatArray
    """(n, 6, 6) sum of weighted steepestᵀ·steepest"""
    whole: BoolArray
    """(n,) the image shows all of it, and it is not flat"""

    def __getitem__(self, rows: BoolArray | IntArray) -> Templates:
        arrays = (self.pitch, self.grey, self.steepest, self.normal)
        pitch, grey, steepest, normal = (a[rows] for a in arrays)
        whole = self.whole[rows]
        return Templates(self.frames[rows], pitch, self.half, grey, steepest, normal, whole)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Where templates lie in another image."""

    places: FloatArray
    """(n, 2) of the templates' middles on the planes of the other image"""
    affinities: FloatArray
    """(n, 2, 2) from places on the templates' planes to places on the others'"""
    covariance: FloatArray
    """(n, 2, 2) of the places, from the residual and the gradients"""
    correlation: FloatArray
    """(n,) weighted, of template and patch; -1 where not converged"""
    converged: BoolArray
    """(n,) the last step was small, and the whole patch is in the image"""


def window(half: int) -> FloatArray:
    """Weights ((2·half + 1)²,) of a patch's samples, a Gaussian; their sum is 1."""
    weight = np.exp(-0.5 * (grid(half) ** 2).sum(1) / (WINDOW * half) ** 2)
    return np.asarray(weight / weight.sum())


def window_variance(half: int) -> float:
    """Return the variance of the samples' places along an axis under their weights [samples²]."""
    return float((window(half) * grid(half)[:, 0] ** 2).sum())


def make_templates(
    camera: CentralModel,
    image: FloatImage,
    frames: TangentFrames,
    pitch: FloatArray,
    half: int,
) -> Templates:
    """Cut patches of half side ``half`` samples, ``pitch`` (n,) [rad] apart, and prepare to find them."""
    n, side = len(frames), 2 * half + 1
    values, pixels = sample(
        camera, image, frames, np.zeros((n, 2)), pitch[:, None, None] * np.eye(2), grid(half + 1)
    )
    square = values.reshape(n, side + 2, side + 2)
    grey, norm, weight = square[:, 1:-1, 1:-1].reshape(n, side * side), np.empty(n), window(half)
    normalise(grey, weight, norm)
    steepest, normal = np.empty((n, side * side, 6)), np.empty((n, 6, 6))
    write_templates(square, grid(half), weight, grey, norm, steepest, normal)
    return Templates(
        frames, pitch, half, grey, steepest, normal, camera.in_image(pixels).all(1) & (norm > LEAST_NORM)
    )


def align(
    camera: CentralModel,
    image: FloatImage,
    templates: Templates,
    frames: TangentFrames,
    places: FloatArray,
    affinities: FloatArray,
    *,
    steps: int = 12,
) -> Alignment:
    """Find each template in ``image`` by the inverse compositional method, all at once.

    The grey at A·u + p on the other plane, with its own mean and norm, is to equal the template's at u; the
    step that the template's derivatives ask for is undone in the map (Baker & Matthews, "Lucas-Kanade 20
    years on", IJCV 2004). Every sample goes through the camera: no lens is too wide.

    Args:
        camera: took the image.
        image: float32 grey values.
        templates: what is looked for.
        frames: (n) planes in the camera's frame on which it is looked for.
        places: (n, 2) start of p, on these planes.
        affinities: (n, 2, 2) start of A.
        steps: at most.
    """
    places, affinities = places.copy(), affinities.copy()
    size = np.einsum("npp->np", templates.normal).max(axis=1, initial=0.0)
    inverse = np.linalg.inv(templates.normal + (_RIDGE * size + 1e-300)[:, None, None] * np.eye(6))
    n, weight = len(places), window(templates.half)
    correlation, scatter = np.full(n, -1.0), np.zeros(n)
    converged, moving = np.zeros(n, dtype=np.bool_), np.flatnonzero(templates.whole)
    for _ in range(steps):
        if not len(moving):
            break
        maps = templates.pitch[moving, None, None] * affinities[moving]
        values, pixels = sample(camera, image, frames[moving], places[moving], maps, grid(templates.half))
        alike, apart, pulls = _compare(templates, moving, values)
        step = np.einsum("npq,nq->np", inverse[moving], pulls)
        length = np.hypot(step[:, 4], step[:, 5])
        step *= np.minimum(1.0, _LONGEST_STEP / np.maximum(length, 1e-12))[:, None]
        # the map after the undone step: A·(I + D)⁻¹, p − A·(I + D)⁻¹·d
        undo = np.linalg.inv(
            np.eye(2) + np.clip(step[:, :4], -_LARGEST_TURN, _LARGEST_TURN).reshape(-1, 2, 2)
        )
        affinities[moving] = affinities[moving] @ undo
        places[moving] -= np.einsum("nij,njk,nk->ni", maps, undo, step[:, 4:])
        still = length < _END
        done = moving[still]
        converged[done] = camera.in_image(pixels[still]).all(1)
        correlation[done] = np.where(converged[done], alike[still], -1.0)
        scatter[done] = apart[still]
        moving = moving[length >= _END]
    spread = templates.pitch[:, None, None] * affinities
    variance = (scatter * (weight**2).sum())[:, None, None] * inverse[:, 4:, 4:]
    return Alignment(
        places, affinities, spread @ variance @ np.swapaxes(spread, 1, 2), correlation, converged
    )


def _compare(
    templates: Templates, rows: IntArray, values: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Correlation (m,), mean square difference (m,), pull (m, 6) of grey values (m, k), normalised here."""
    m, weight = len(rows), window(templates.half)
    norm, alike, apart, pulls = np.empty(m), np.empty(m), np.empty(m), np.empty((m, 6))
    normalise(values, weight, norm)
    write_pulls(rows, values, weight, templates.grey, templates.steepest, alike, apart, pulls)
    return alike, apart, pulls
