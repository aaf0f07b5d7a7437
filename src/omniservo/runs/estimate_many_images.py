"""Motion, structure and scale from three image files or more of a target that stands still."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from omniservo.calibration.hand_eye import load_hand_eye, load_robot_poses, load_robot_sigmas
from omniservo.camera_files import named_model
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation import (
    FurtherView,
    KnownDisplacements,
    KnownPoints,
    MultiViewEstimate,
    TwoViewEstimate,
    ViewDistance,
    ViewPoints,
    candidate_views,
    estimate_views,
)
from omniservo.estimation.two_view_input import stated_length
from omniservo.estimation.view_scale import ViewScale
from omniservo.field_docs import with_field_docs
from omniservo.files.image_files import copies_of
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.geometry.pose_fields import pose_fields
from omniservo.perception import DotKind, JoinedPoints, TagKind, join_images
from omniservo.runs.estimate_images import read_image
from omniservo.runs.feature_kind_of import KindName, feature_kind
from omniservo.runs.job_progress import Progress
from omniservo.short_repr import short_repr
from omniservo.targets import Target

FORMAT = "omniservo.views/1"

MOST_IMAGES = 50

_JOINED = 0.9
"""share of the job that is behind when the images are joined"""


LEAST_SIGMAS = (1e-5, 1e-5)
"""[m], [rad] σ of a reported pose is taken as so much where a hand-eye calibration found less."""

CORNERS = 4


@with_field_docs
@dataclass(frozen=True)
class ImageScale:
    """What is known of lengths; at most one of them."""

    displacement: float | None = None
    """between the camera centres of the first and the last image [m]"""
    length: tuple[int, int, float] | None = None
    """of dots i and j, numbered from 0, top to bottom, then left to right, as the first image shows them; of
    corners of tags, 4·tag + corner: the distance of the two [m]"""
    edge: float | None = None
    """of every tag [m]"""
    target: Path | None = None
    """a target file: tags of known size and place"""
    poses: str | None = None
    """a file with the arm's poses, as `load_robot_poses` takes it; needs ``mount``"""
    mount: Path | None = None
    """a file that ``calibrate-hand-eye`` wrote: where the camera sits on the flange"""

    def check(self) -> None:
        """Raise InputError where two are given, or half of the last."""
        if (self.poses is None) != (self.mount is None):
            one, other = ("mount", "poses") if self.poses is None else ("poses", "mount")
            raise InputError(f"{other}: missing; {one} is given, and the arm's poses need both")
        names = [
            n for n in ("displacement", "length", "edge", "target", "poses") if getattr(self, n) is not None
        ]
        if len(names) > 1:
            raise InputError(f"{', '.join(names)}: all given; one of them gives the scale")


@with_field_docs
@dataclass(frozen=True, eq=False)
class EstimatedViews:
    """Images with what was seen in them and what follows from it."""

    images: tuple[Path, ...]
    points: JoinedPoints
    estimate: MultiViewEstimate
    camera: CentralModel
    further: tuple[FurtherView, ...]
    """what one further image would gain, the best first; empty without an estimate"""

    __repr__ = short_repr

    def statuses(self) -> list[tuple[str, str]]:
        """Return of each image what became of it, and why."""
        found, reasons = self.estimate, self.points.reasons
        pairs = []
        for view, status in enumerate(found.view_status):
            alone = status != "ok" and status != "by_displacement" and reasons[view]
            pairs.append(("not_matched", reasons[view]) if alone else (status, found.view_reasons[view]))
        return pairs

    def two_view(self) -> TwoViewEstimate:
        """Return what all images say about the motion from the first to the last one.

        Raises:
            InputError: the first image has no pose.
        """
        return replace(self.estimate.two_view(len(self.images) - 1), camera=self.camera)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers; NaN becomes None."""
        found = self.estimate
        images = []
        for view, (status, reason) in enumerate(self.statuses()):
            pose, spread = found.initial_T_views[view], found.covariance[view]
            images.append(
                {
                    "image": str(self.images[view]),
                    "status": status,
                    "reason": reason,
                    "points": int(found.inliers[view].sum()),
                    "pose": None if pose is None else pose_fields(pose),
                    "covariance": None if pose is None else spread.tolist(),
                }
            )
        placed = ~np.isnan(found.points[:, 0])
        return {
            "format": FORMAT,
            "status": found.status,
            "message": found.message,
            "frame": None if found.reference is None else str(self.images[found.reference]),
            "images": images,
            "is_metric": found.is_metric,
            "size_sigma": None if math.isnan(found.size_sigma) else found.size_sigma,
            "points": found.points[placed].tolist(),
            "points_covariance": found.points_covariance[placed].tolist(),
            "rms_px": None if math.isnan(found.rms_px) else found.rms_px,
            "noise_px": None if math.isnan(found.noise_px) else found.noise_px,
            "seconds": found.seconds,
            "further": [
                {
                    "pose": pose_fields(view.initial_T_view),
                    "points": view.points,
                    "position_sigma": list(view.position_sigma),
                    "rotation_sigma": list(view.rotation_sigma),
                    "size_sigma": list(view.size_sigma),
                }
                for view in self.further
            ],
        }


def estimate_many_images(
    camera: str | CentralModel,
    images: Sequence[str | Path],
    *,
    features: KindName = "dots",
    dictionary: str | None = None,
    scale: ImageScale | None = None,
    calibration_covariance: FloatArray | None = None,
    progress: Progress = lambda stage, done: None,
) -> EstimatedViews:
    """Return what two to `MOST_IMAGES` image files of a target that stands still say, in any order.

    A file that is the copy of an earlier one is not used: it says nothing more, and counted twice it would
    make the result look surer than it is.

    Args:
        camera: a calibration file, a preset's name, or a camera, of any model.
        images: the files; poses are in the frame of the first that has one.
        features: what is looked for.
        dictionary: of the tags.
        scale: what makes the estimate metric. None: nothing.
        calibration_covariance: as `Calibration.covariance`. None: as the camera states it.
        progress: called with what is being done, and about what share of the job is behind.

    Raises:
        InputError: a file that is not what it should be, or scales that do not go together.
    """
    model = named_model(camera) if isinstance(camera, str) else camera
    files, known = tuple(Path(image) for image in images), scale or ImageScale()
    if not 2 <= len(files) <= MOST_IMAGES:
        raise InputError(f"images: {len(files)} given; legal: 2 to {MOST_IMAGES}")
    known.check()
    target = None if known.target is None else Target.load(known.target)
    kind = feature_kind(features, dictionary, target)
    if known.edge is not None and not isinstance(kind, TagKind):
        raise InputError(f"edge: given with features: {features!r}; 'tags' is needed")
    if known.length is not None and not isinstance(kind, TagKind | DotKind):
        raise InputError(f"length: given with features: {features!r}; 'dots' or 'tags' is needed")
    arm = _displacements(known, files)
    pictures = [read_image(file, model) for file in files]
    points = _of_originals(join_images(model, pictures, kind, progress), files)
    progress("estimating motion and structure", _JOINED)
    row_of = partial(_row, model, pictures[0], points)
    stated = arm if arm is not None else _scale(known, points, row_of, target, dictionary)
    views = ViewPoints(points.pixels, points.visible, points.noise, points.window)
    found = estimate_views(model, views, scale=stated, calibration_covariance=calibration_covariance)
    further = tuple(candidate_views(found)) if found.status == "ok" else ()
    return EstimatedViews(files, points, found, model, further)


def _of_originals(points: JoinedPoints, files: Sequence[Path]) -> JoinedPoints:
    """Return the points without what copies of earlier files show; as they are where all show one image."""
    copied = copies_of(files)
    if len(copied) == len(files) - 1:
        return points
    visible, reasons = points.visible.copy(), list(points.reasons)
    for view, original in copied.items():
        visible[view], reasons[view] = False, f"a copy of {original}"
    return replace(points, visible=visible, reasons=tuple(reasons))


def _displacements(scale: ImageScale, files: Sequence[Path]) -> KnownDisplacements | None:
    if scale.poses is None or scale.mount is None:
        return None
    mount, spread = load_hand_eye(scale.mount)
    sigmas = np.maximum(load_robot_sigmas(scale.mount), LEAST_SIGMAS)
    return KnownDisplacements.of_poses(
        load_robot_poses(scale.poses).of_images(files),
        mount,
        position_sigma=float(sigmas[0]),
        rotation_sigma=float(sigmas[1]),
        mount_covariance=spread,
    )


def _scale(
    scale: ImageScale,
    points: JoinedPoints,
    row_of: Callable[[int], int],
    target: Target | None,
    dictionary: str | None,
) -> ViewScale:
    if scale.displacement is not None:
        metres = stated_length("displacement", scale.displacement)
        return ViewDistance(0, len(points.visible) - 1, metres)
    if scale.length is not None:
        i, j, metres = scale.length
        return (row_of(i), row_of(j)), stated_length("length: metres", metres)
    if points.ids is None:
        return None
    if target is not None:
        corners, known = target.corners_of(points.ids, dictionary)
        if known.sum() < CORNERS:
            raise InputError("target: none of its tags is in two of the images")
        return KnownPoints(np.flatnonzero(known), corners[known])
    if scale.edge is None:
        return None
    half = 0.5 * stated_length("edge", scale.edge)
    square = half * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    tags, groups = np.unique(points.ids // CORNERS, return_inverse=True)
    if not len(tags):
        raise InputError("edge: no tag is in two of the images")
    return KnownPoints(np.arange(len(points.ids)), square[points.ids % CORNERS], groups)


def _row(camera: CentralModel, first: ByteArray, points: JoinedPoints, number: int) -> int:
    """Return the row of a dot that the first image shows, or of a tag's corner."""
    if points.ids is None:
        return DotKind().row("length", number, first, camera, points.pixels[0])
    rows = {int(points.ids[row]): row for row in np.flatnonzero(points.visible[0])}
    if number not in rows:
        legal = ", ".join(str(k) for k in sorted(rows)[:CORNERS]) + (", …" if len(rows) > CORNERS else "")
        raise InputError(
            f"length: point {number} given; in the first image and another are {legal or 'none'}"
        )
    return int(rows[number])
