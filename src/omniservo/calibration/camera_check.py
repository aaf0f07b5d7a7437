"""Was the camera bumped? From an image of when it stood right, and one of now."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from omniservo.cameras import ModelError
from omniservo.cameras.models import CentralModel
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray, owned
from omniservo.perception import find_features
from omniservo.perception.align_patches import Templates, align, make_templates
from omniservo.perception.features import Features
from omniservo.perception.match_features import match_features
from omniservo.perception.patch_kernels import FloatImage
from omniservo.perception.tangent_patches import TangentFrames

FALSE_ALARM_RATE = 0.01
"""the largest that is stated, where what is seen otherwise stands still"""
SHARED_ERROR = 0.1
"""[px] standard deviation by which other light shifts all that is seen in one part of the image"""
ALIKE_OVER = 0.2
"""of the image's width: how far such a shift is alike"""
FARTHEST = 6.0
"""[px] from where a feature is expected to where its patch may be found"""
NEAR = 4.0
"""[px] within which similar features agree on a rotation"""
LEAST_CORRELATION = 0.85
LEAST_FEATURES, LEAST_CELLS = 12, 5
"""that agree on one motion; fewer say nothing of the camera"""
CELLS = (6, 4)
"""of the image, columns and rows: what moves in the scene fills few of them"""
SCATTER = (0.05, 0.5, 0.05)
"""[px], [px], 1: least and most standard deviation of the features about the motion; the most grows with the
shift, as parallax does"""
RIVAL = 0.7
"""of the parts that one motion fills: where another one fills so many, neither is accepted"""
DEPTH_SPREAD = 0.5
"""standard deviation of what is seen's inverse distances over their mean, alike over `ALIKE_OVER` too"""
STRAY = 0.05
"""standard deviation of the displacement over the distance of what is seen: bumps are small"""
_PRIOR = np.diag([0.0] * 3 + [1.0 / STRAY**2] * 3)
"""information on rotation and displacement before anything is seen"""
_TUKEY = 4.685
_MEDIAN_LENGTH = 1.1774
"""of two normal coordinates of standard deviation 1"""
_MOST, _HALF, _ROUNDS, _TRIALS = 1000, 8, 12, 300


@with_field_docs
@dataclass(frozen=True, eq=False)
class CameraCheck:
    """Whether a camera moved between two images; of `check_camera`."""

    moved: bool | None
    """None: it cannot be decided, for `reason`"""
    rotation: FloatArray
    """(3,) [rad] rotation vector of the camera's frame of now in the one it had; NaN where moved is None"""
    translation: FloatArray
    """(3,) displacement of the camera over the mean distance of what is seen, in the frame it had"""
    covariance: FloatArray
    """(6, 6) of (rotation, translation)"""
    displacement_px: float
    """[px] root mean square over the features that stand still in the scene"""
    probability: float
    """that a camera that stands still shows as much"""
    features: int
    """that agree on this motion, of those found again"""
    found_again: int
    reason: str
    """one sentence"""

    def __post_init__(self) -> None:
        for name in ("rotation", "translation", "covariance"):
            object.__setattr__(self, name, owned(getattr(self, name)))

    @property
    def angle(self) -> float:
        """[rad] of the rotation."""
        return float(np.linalg.norm(self.rotation))

    @property
    def sigma(self) -> float:
        """[rad] standard deviation of the angle; of the rotation's worst axis where it is not rotated."""
        spread = self.covariance[:3, :3]
        if self.moved and self.angle > 0.0:
            axis = self.rotation / self.angle
            return math.sqrt(max(0.0, float(axis @ spread @ axis)))
        return math.sqrt(float(np.linalg.eigvalsh(spread)[-1])) if np.isfinite(spread).all() else math.nan

    def to_dict(self) -> dict[str, Any]:
        """Return what ``omniservo camera check --json`` prints."""
        known = self.moved is not None
        return {
            "moved": self.moved,
            "rotation_rad": self.angle if known else None,
            "direction": (self.rotation / max(self.angle, 1e-300)).tolist() if known else None,
            "sigma": self.sigma if known else None,
            "rotation_vector": self.rotation.tolist() if known else None,
            "translation_over_distance": self.translation.tolist() if known else None,
            "covariance": self.covariance.tolist() if known else None,
            "displacement_px": self.displacement_px if known else None,
            "probability": self.probability if known else None,
            "false_alarm_rate": FALSE_ALARM_RATE,
            "features": self.features,
            "found_again": self.found_again,
            "reason": self.reason,
        }


@dataclass(frozen=True, eq=False)
class _Motion:
    """A motion of the camera and the features that agree with it."""

    twist: FloatArray
    """(6,) rotation vector, displacement over distance"""
    left: FloatArray
    """(n, 2) [px] that the motion leaves of where the features found again are"""
    shift: FloatArray
    """(n, 2) [px] by which the motion moves them"""
    jacobian: FloatArray
    """(n, 2, 6) of their pixels by the twist"""
    weight: FloatArray
    """(n,) of Tukey's, times 1/σ²; 0: another motion, or none"""
    pixels: FloatArray
    """(n, 2) where they were"""

    @property
    def agree(self) -> BoolArray:
        return np.asarray(self.weight > 0.0)


def check_camera(camera: CentralModel, reference: ByteArray, now: ByteArray) -> CameraCheck:
    """Tell whether a camera that watches a scene moved since a reference image, by how much and which way.

    Natural features of the reference are found again by their patches, with gain and offset of their own,
    from two starts: where they were, and where the rotation on which most similar features agree brings
    them. A small motion (rotation, and displacement over one common distance) is fitted to each robustly
    (Tukey's weights); the one that explains more of the image is the camera's. What moves in the scene fills
    less of it, or both are given up: ``moved`` None, unless neither leaves anything where it was. The motion
    is tested against none at all (χ², 6 degrees of freedom) with the scatter of what was found, clustered by
    parts of the image, and with `SHARED_ERROR` alike over `ALIKE_OVER`, for light that shifts edges; the
    covariance counts distances that differ, too.

    Args:
        camera: took both images.
        reference: (height, width) grey values, uint8: the camera where it should be.
        now: likewise, of now.

    Raises:
        InputError: not such images, or not of the camera's size.
    """
    was, found = find_features(reference, camera), find_features(now, camera)
    rows = _spread(camera, was)
    if len(rows) < LEAST_FEATURES:
        return _unknown(0, 0, f"the reference shows {len(was)} features; {LEAST_FEATURES} are needed")
    size = np.linalg.norm(was.axes[rows], axis=1, keepdims=True)
    pixel = size[:, 0] / was.scale[rows]
    frames = TangentFrames(was.bearings[rows], was.axes[rows] / size)
    pitch = np.maximum(pixel, 0.5 * size[:, 0])
    templates = make_templates(camera, reference.astype(np.float32), frames, pitch, _HALF)
    image, pairs = now.astype(np.float32), _similar(was, found)
    near = NEAR * float(np.median(pixel))
    starts = Rotation.identity(), _common(*pairs, near)
    fits = [_fit(camera, image, templates, pixel, start) for start in starts]
    best = max(filter(None, fits), key=lambda fit: _cells(camera, fit), default=None)
    if best is None:
        return _unknown(0, 0, f"none of {len(rows)} features of the reference is found again")
    agree, again = int(best.agree.sum()), len(best.weight)
    if agree < LEAST_FEATURES or _cells(camera, best) < LEAST_CELLS:
        words = "one motion; they are too few, or in one part of the image"
        return _unknown(agree, again, f"{agree} of {len(rows)} features of the reference agree on {words}")
    left = np.linalg.norm(_seen_from(best.twist, pairs[0]) - pairs[1], axis=1) > near
    rival = _fit(camera, image, templates, pixel, _common(pairs[0][left], pairs[1][left], near))
    if rival is None or not _apart(best, rival) or _cells(camera, rival) <= RIVAL * _cells(camera, best):
        return _judged(camera, best, np.zeros(6), again)
    if min(_size(best), _size(rival)) < FARTHEST:
        return _unknown(agree, again, "two motions explain as much of the image each")
    # near and far move apart, and nothing stands still
    return _judged(camera, best, best.twist - rival.twist, again)


def _judged(camera: CentralModel, motion: _Motion, off: FloatArray, again: int) -> CameraCheck:
    """Test a motion against none, and say how sure it is; ``off`` (6,): by how much another one differs.

    Distances that differ move nothing of what a camera that stands still sees: they are no part of the test.
    """
    still = _covariance(camera, motion, np.zeros(3))
    covariance = _covariance(camera, motion, motion.twist[3:]) + np.outer(off, off)
    square = float(motion.twist @ np.linalg.solve(still, motion.twist))
    probability = float(chdtrc(6, square))
    moved = probability < FALSE_ALARM_RATE
    rms, count = _size(motion), int(motion.agree.sum())
    words = f"{count} of {again} features found again agree: "
    words += f"the image moved by {rms:.2f} px" if moved else "none that is more than chance"
    return CameraCheck(
        moved, motion.twist[:3], motion.twist[3:], covariance, rms, probability, count, again, words
    )


def _unknown(agree: int, again: int, reason: str) -> CameraCheck:
    nothing = np.full(6, math.nan)
    return CameraCheck(
        None, nothing[:3], nothing[3:], np.full((6, 6), math.nan), math.nan, math.nan, agree, again, reason
    )


def _spread(camera: CentralModel, features: Features) -> IntArray:
    """Return the strongest features of every part of the image, in turn."""
    number, taken = _cell(camera, features.points.pixels), np.zeros(CELLS[0] * CELLS[1], dtype=int)
    turn = np.empty(len(number), dtype=int)
    for k, cell in enumerate(number):
        turn[k] = taken[cell]
        taken[cell] += 1
    return np.asarray(np.argsort(turn, kind="stable")[:_MOST])


def _similar(was: Features, found: Features) -> tuple[FloatArray, FloatArray]:
    """Return the bearings (m, 3) of features of both images that look alike; none where that is unclear."""
    pairs = match_features(was, found).pairs
    return was.bearings[pairs[:, 0]], found.bearings[pairs[:, 1]]


def _common(was: FloatArray, now: FloatArray, near: float) -> Rotation | None:
    """Return the rotation now_R_was on which most pairs of bearings agree to ``near`` [rad] (RANSAC)."""
    if len(was) < LEAST_FEATURES:
        return None
    picks = np.random.default_rng(0).integers(len(was), size=(_TRIALS, 2))
    turns = _triads(now[picks]) @ np.swapaxes(_triads(was[picks]), 1, 2)
    agree = np.linalg.norm(np.einsum("tij,nj->tni", turns, was) - now, axis=2) < near
    best = agree[int(np.argmax(agree.sum(1)))]
    return Rotation.align_vectors(now[best], was[best])[0] if best.sum() >= LEAST_FEATURES else None


def _triads(pairs: FloatArray) -> FloatArray:
    """Return right-handed frames (t, 3, 3), columns, of pairs of bearings (t, 2, 3); 0 where both are one."""
    one, two = pairs[:, 0], pairs[:, 1]
    axes = [one, np.cross(one, two), np.cross(one, np.cross(one, two))]
    length = [np.linalg.norm(axis, axis=1, keepdims=True) for axis in axes]
    return np.stack([x / np.where(n > 1e-6, n, math.inf) for x, n in zip(axes, length, strict=True)], axis=2)


def _fit(
    camera: CentralModel, image: FloatImage, templates: Templates, pixel: FloatArray, start: Rotation | None
) -> _Motion | None:
    """Find the patches again near where ``start`` (now_R_was) brings them, and fit a small motion.

    ``pixel`` (n,) [rad] is a pixel's size at each.
    """
    if start is None:
        return None
    old = templates.frames
    frames = TangentFrames(start.apply(old.bearings), start.apply(old.first))
    n = len(old)
    found = align(camera, image, templates, frames, np.zeros((n, 2)), np.broadcast_to(np.eye(2), (n, 2, 2)))
    seen, good = camera.project(frames.directions(found.places[:, None])[:, 0])
    good &= found.converged & (found.correlation > LEAST_CORRELATION)
    good &= np.linalg.norm(found.places, axis=1) < FARTHEST * pixel
    return _robust_motion(camera, old.bearings[good], seen[good], start.inv().as_rotvec())


def _robust_motion(
    camera: CentralModel, bearings: FloatArray, found_at: FloatArray, turn: FloatArray
) -> _Motion | None:
    """Return the motion that takes bearings (n, 3) to pixels (n, 2), by Tukey's weights, from a rotation on.

    None: fewer than `LEAST_FEATURES` agree.
    """
    if len(bearings) < LEAST_FEATURES:
        return None
    expected = camera.project(bearings)[0]
    shift = float(np.median(np.linalg.norm(found_at - expected, axis=1)))
    twist, weight = np.concatenate((turn, np.zeros(3))), np.ones(len(bearings))
    for _ in range(_ROUNDS):
        jacobian = _jacobian(camera, bearings, twist)
        left = found_at - _moved_pixels(camera, bearings, twist)
        length = np.linalg.norm(left, axis=1)
        scale = float(np.median(length[weight > 0.0])) / _MEDIAN_LENGTH
        scale = min(max(scale, SCATTER[0]), SCATTER[1] + SCATTER[2] * shift)
        u = length / (_TUKEY * scale)
        weight = np.where(u < 1.0, (1.0 - u**2) ** 2, 0.0) / scale**2
        if (weight > 0.0).sum() < LEAST_FEATURES:
            return None
        pull = np.einsum("nij,n,ni->j", jacobian, weight, left) - _PRIOR @ twist
        step = np.linalg.solve(np.einsum("nij,n,nik->jk", jacobian, weight, jacobian) + _PRIOR, pull)
        twist = _composed(twist, step)
        if np.linalg.norm(step) < 1e-9:
            break
    moved = _moved_pixels(camera, bearings, twist)
    return _Motion(twist, found_at - moved, moved - expected, jacobian, weight, expected)


def _composed(twist: FloatArray, step: FloatArray) -> FloatArray:
    rotation = Rotation.from_rotvec(twist[:3]) * Rotation.from_rotvec(step[:3])
    return np.concatenate((rotation.as_rotvec(), twist[3:] + step[3:]))


def _seen_from(twist: FloatArray, bearings: FloatArray) -> FloatArray:
    """Return where points at distance 1 lie in the camera's frame of now: R⁻¹(s − τ)."""
    return np.asarray(Rotation.from_rotvec(twist[:3]).inv().apply(bearings - twist[3:]))


def _moved_pixels(camera: CentralModel, bearings: FloatArray, twist: FloatArray) -> FloatArray:
    """Return the pixels now of points at distance 1."""
    return camera.project(_seen_from(twist, bearings))[0]


def _jacobian(camera: CentralModel, bearings: FloatArray, twist: FloatArray) -> FloatArray:
    """Return ∂pixel/∂(rotation on the right, τ) (n, 2, 6) by central differences."""
    step, columns = 1e-6, []
    for i in range(6):
        ends = [
            _moved_pixels(camera, bearings, _composed(twist, sign * step * np.eye(6)[i])) for sign in (1, -1)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(columns, axis=2)


def _cell(camera: CentralModel, pixels: FloatArray) -> IntArray:
    """Return the number of the part of the image that each pixel lies in."""
    columns, rows = (
        np.clip((pixels[:, i] / size * count).astype(int), 0, count - 1)
        for i, (size, count) in enumerate(zip((camera.width, camera.height), CELLS, strict=True))
    )
    return np.asarray(columns + CELLS[0] * rows)


def _cells(camera: CentralModel, motion: _Motion) -> int:
    """Return how many parts of the image have a feature that agrees."""
    return len(np.unique(_cell(camera, motion.pixels[motion.agree])))


def _size(motion: _Motion) -> float:
    """Return by how much a motion moves what agrees with it, root mean square [px]."""
    return math.sqrt(float((motion.shift[motion.agree] ** 2).sum(1).mean()))


def _apart(one: _Motion, other: _Motion) -> bool:
    """Tell whether two motions move the image differently."""
    shift = one.jacobian[one.agree] @ (one.twist - other.twist)
    return bool(np.sqrt((shift**2).sum(1).mean()) > 1.0)


def _covariance(camera: CentralModel, motion: _Motion, displacement: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of a fitted motion: scatter clustered by parts of the image, and light.

    ``displacement`` (3,) over the mean distance: with it distances that differ count.
    """
    agree = motion.agree
    jacobian, weight, pixels = motion.jacobian[agree], motion.weight[agree], motion.pixels[agree]
    inverse = np.linalg.inv(np.einsum("nij,n,nik->jk", jacobian, weight, jacobian) + _PRIOR)
    pulls = weight[:, None] * np.einsum("nij,ni->nj", jacobian, motion.left[agree])
    number = _cell(camera, pixels)
    sums = np.stack([pulls[number == c].sum(0) for c in np.unique(number)])
    count = len(sums)
    scatter = sums.T @ sums * count / max(1, count - 1)
    alike = ModelError(1.0, ALIKE_OVER * camera.width).covariance(pixels, pixels)
    weighted = weight[:, None, None] * jacobian
    shared = SHARED_ERROR**2 * np.einsum("nij,nm,mik->jk", weighted, alike, weighted)
    parallax = DEPTH_SPREAD * np.einsum("nij,ni->nj", weighted, jacobian[:, :, 3:] @ displacement)
    shared += parallax.T @ alike @ parallax
    return np.asarray(inverse @ (scatter + shared + _PRIOR) @ inverse)
