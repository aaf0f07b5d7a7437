"""Matched features brought to common places of the surface, to a fraction of a pixel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from omniservo.cameras.models import CentralModel
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray, owned
from omniservo.perception.agreeing_pairs import agree_on_one_plane, agreeing_pairs
from omniservo.perception.align_patches import WINDOW, Alignment, align, make_templates, window_variance
from omniservo.perception.features import Features
from omniservo.perception.image_points import ImagePoints
from omniservo.perception.match_features import LEAST_PAIRS, FeatureMatch, Status
from omniservo.perception.perspective_bias import without_perspective_bias
from omniservo.perception.tangent_patches import TangentFrames

HALF = 8
"""[samples] half the side of a patch"""
LEAST_CORRELATION = 0.85
FARTHEST = 1.5
"""[scales] from where the feature was found to where its patch fits; 1.5 px are always allowed"""
MOST_SHEAR = 2.0
"""largest stretch of a patch over the smallest, and over what the features' scales say"""
LEAST_ERROR = 0.02
"""[px] standard deviation of the best pair: the images' own sampling"""
CORRELATED = (1.1, 20.0)
"""So many neighbouring samples err together, the factor of the variance: noise by interpolation; the more the
patches differ, by 1 − correlation, the less it is noise and the farther what differs hangs together."""
LEAST_SHARE = 1.0 / 16.0
"""of the features of the image that has fewer. As many pairs are wrong however few are right: fewer pairs
are trusted only where they agree on one motion, or most of them on one plane, beyond chance."""
MOST_ERROR = 0.3
"""[px] standard deviation of the worst pair, in its worst direction"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class ImageMatch:
    """What `refine_matches` and `match_images` found; only ``status`` "ok" is a match.

    Row k of both images is one point.
    """

    initial: ImagePoints
    """(m) pixels of the initial image; empty unless "ok" """
    goal: ImagePoints
    """(m) pixels of the goal image. What is uncertain is where the two differ: each image has half of
    that variance"""
    correlation: FloatArray
    """(m,) of the two patches, at most 1"""
    window: FloatArray
    """(m,) standard deviation [px] of the Gaussian window of the patch, in the initial image"""
    status: Status
    """as of `match_features`; "too_few" also where fewer patches fit than eight, or than `LEAST_SHARE`; of
    `match_images`, "blurred": an image is smeared by motion"""
    reason: str
    """one sentence"""

    def __post_init__(self) -> None:
        object.__setattr__(self, "correlation", owned(self.correlation))
        object.__setattr__(self, "window", owned(self.window))

    def __len__(self) -> int:
        return len(self.initial)


def refine_matches(
    camera: CentralModel,
    image_initial: ByteArray,
    image_goal: ByteArray,
    initial: Features,
    goal: Features,
    match: FeatureMatch,
) -> ImageMatch:
    """Lay the goal's patch round each matched feature on the initial image's, and keep the pairs that fit.

    The pixel of the initial image is where the feature was found; the pixel of the goal is where an affine
    image of the patch round it, with gain and offset, fits best (`align_patches`). A pair is left out where
    that does not converge, leads far from the feature or to another shape than its scale, correlates badly or
    is uncertain: that finds most wrong pairs. A place of either image that stands in several keeps the best.

    The covariance is that of the residual and the gradients, times `CORRELATED`, and not less than
    `LEAST_ERROR`² in all.

    Args:
        camera: took both images.
        image_initial: (height, width) grey values, uint8.
        image_goal: likewise.
        initial: features of the initial image.
        goal: features of the goal image.
        match: of these features; one that is not "ok" is returned as it is.
    """
    if match.status != "ok":
        return refused(match.status, match.reason)
    one, other = _frames(initial, match.pairs[:, 0]), _frames(goal, match.pairs[:, 1])
    size, size_goal = (
        np.linalg.norm(f.axes[k], axis=1) for f, k in zip((initial, goal), match.pairs.T, strict=True)
    )
    ratio = size_goal / size
    pixel, pixel_goal = size / initial.scale[match.pairs[:, 0]], size_goal / goal.scale[match.pairs[:, 1]]
    pitch = np.maximum(np.maximum(pixel, pixel_goal / ratio), 0.5 * size)
    templates = make_templates(camera, image_initial.astype(np.float32, order="C"), one, pitch, HALF)
    found = align(
        camera, image_goal.astype(np.float32, order="C"), templates, other, np.zeros((len(ratio), 2)),
        ratio[:, None, None] * np.eye(2),
    )  # fmt: skip
    near = np.linalg.norm(found.places, axis=1) < np.maximum(FARTHEST * size_goal, 1.5 * pixel_goal)
    good = found.converged & (found.correlation > LEAST_CORRELATION) & near & _plausible(found, ratio)
    found = without_perspective_bias(found, one, other, window_variance(HALF) * pitch**2, good)
    pixels, seen = camera.project(other.directions(found.places[:, None])[:, 0])
    errors = _errors(camera, found, one, other)
    good &= seen & (np.sqrt(np.linalg.eigvalsh(errors.sum(0))[:, 1]) < MOST_ERROR)
    start = initial.points.pixels[match.pairs[:, 0]]
    good[good] = _once((start[good], pixels[good]), found.correlation[good])
    count = int(good.sum())
    least = max(LEAST_PAIRS, math.ceil(LEAST_SHARE * min(len(initial.points), len(goal.points))))
    if count < least and not _agree(camera, start[good], pixels[good]):
        seen_in = f"{len(initial.points)} and {len(goal.points)} features"
        words = f"{count} of {len(good)} pairs look alike all round; {least} are needed, of {seen_in}"
        return refused("too_few", words)
    one_picture, the_other = (
        ImagePoints(p[good], e[good]) for p, e in zip((start, pixels), errors, strict=True)
    )
    window = WINDOW * HALF * pitch / pixel
    return ImageMatch(one_picture, the_other, found.correlation[good], window[good], "ok", f"{count} pairs")


def refused(status: Status, reason: str) -> ImageMatch:
    """Return no match, and why."""
    none = ImagePoints(np.zeros((0, 2)), np.zeros((0, 2, 2)))
    return ImageMatch(none, none, np.zeros(0), np.zeros(0), status, reason)


def _agree(camera: CentralModel, initial: FloatArray, goal: FloatArray) -> bool:
    """Tell whether pairs (n, 2) [px] agree on one motion, or most of them on one plane, beyond chance."""
    return agreeing_pairs(camera, initial, goal) is not None or agree_on_one_plane(camera, initial, goal)


def _errors(camera: CentralModel, found: Alignment, one: TangentFrames, other: TangentFrames) -> FloatArray:
    """Covariance (2, n, 2, 2) [px²] of the pixels in both images: half of the difference's in each."""
    upright = np.linalg.det(found.affinities) > 0.0
    back = np.linalg.inv(np.where(upright[:, None, None], found.affinities, np.eye(2)))
    maps = np.stack([one.jacobians(camera) @ back, other.jacobians(camera)])
    together = CORRELATED[0] + CORRELATED[1] * (1.0 - found.correlation[:, None, None])
    spread = 0.5 * together * maps @ found.covariance @ np.swapaxes(maps, 2, 3)
    return np.where(np.isfinite(spread), spread, 1e6) + 0.5 * LEAST_ERROR**2 * np.eye(2)


def _frames(features: Features, rows: IntArray) -> TangentFrames:
    """Planes at features, turned to their orientation."""
    axes = features.axes[rows]
    return TangentFrames(features.bearings[rows], axes / np.linalg.norm(axes, axis=1, keepdims=True))


def _plausible(found: Alignment, ratio: FloatArray) -> BoolArray:
    """Whether the stretch of a patch is about what the scales of the features say."""
    stretch = np.linalg.svd(found.affinities / ratio[:, None, None], compute_uv=False)
    upright = np.linalg.det(found.affinities) > 0.0
    return np.asarray(upright & (stretch[:, 0] < MOST_SHEAR * np.minimum(1.0, stretch[:, 1]) * np.sqrt(2.0)))


def _once(places: tuple[FloatArray, FloatArray], correlation: FloatArray) -> BoolArray:
    """False where a better pair has the same place in one of the two images."""
    once = np.ones(len(correlation), dtype=np.bool_)
    for pixels in places:
        for i, j in cKDTree(pixels).query_pairs(1.0, output_type="ndarray"):
            once[i if correlation[i] < correlation[j] else j] = False
    return once
