"""What two views say about the camera's motion and the target's structure."""

from __future__ import annotations

import json
import math
import time
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast, get_args

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.conversion import unified_image
from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.drawn import drawn
from omniservo.errors import InputError
from omniservo.estimation.deferred import deferring
from omniservo.estimation.matches import Matches
from omniservo.estimation.uncertainty.joint_uncertainty import (
    SOURCES,
    EstimateSamples,
    JointUncertainty,
    Source,
)
from omniservo.estimation.uncertainty.likelihood_samples import likelihood_samples
from omniservo.field_docs import with_field_docs
from omniservo.files import parse_document, read_text, write_whole
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array, finite_number, owned
from omniservo.geometry.pose_fields import pose_fields

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMAT = "omniservo.estimate/1"

LARGEST_FILE = 2**28
"""[bytes] It holds the covariance of all points with all others."""

Status = Literal[
    "ok", "too_few_points", "planar_points", "pure_rotation", "no_motion", "ambiguous", "not_converged"
]
STATUSES: tuple[str, ...] = get_args(Status)

_FIELDS = {
    "format", "status", "message", "goal", "points", "is_metric", "covariance", "points_covariance",
    "inliers", "rms_px", "noise_px", "residuals_px", "seconds", "scale_sigma", "uncertainty",
    "camera", "alternatives",
}  # fmt: skip
_ADDED = {"scale_sigma", "uncertainty", "camera", "alternatives"}
"""Fields that older files of this format do not have."""


@with_field_docs
@deferring("covariance", "points_covariance", "uncertainty")
@dataclass(frozen=True, eq=False)
class TwoViewEstimate:
    """Motion and structure from n matched pixels, or the reason why there is none.

    Any status but "ok" is no pose: ``initial_T_goal`` is None and every number that belongs to a pose is
    NaN, in arrays of unchanged shape.
    """

    status: Status
    """"ok"; "too_few_points": fewer than five matches (four before a plane), or fewer than eight of many that
    agree; "no_motion", "pure_rotation", "planar_points": the identity, a rotation, a homography explains the
    pixels as well as motion and structure do, wrong matches aside; "ambiguous": a second motion, far from
    the first, is nearly as likely, or explains other matches by itself; "not_converged": no minimum was
    found, or none that the matches agree with, or they come from another camera or zoom, or not from one
    rigid scene, or are badly found."""
    message: str
    """One sentence with the evidence; empty for "ok"."""
    initial_T_goal: RigidTransform | None
    """{R, t}: coordinates in the goal camera to coordinates in the initial one. None unless "ok"."""
    points: FloatArray
    """(n, 3) [m], or in lengths of t where not metric; initial camera frame. A rejected match has its
    linear structure, or NaN where its rays do not meet in front of both cameras."""
    is_metric: bool
    """False: ‖t‖ = 1, the two views do not tell more."""
    covariance: FloatArray
    """(6, 6) of (translation, rotation vector applied on the right of initial_T_goal); [m], [rad]. That of
    pixel noise is σ²(JᵀJ)⁻¹ where the noise is stated, σ being that or what the residuals say where that is
    more; else Student's t with n − 5 degrees of freedom, σ²(n−5)/(n−7) (JᵀJ)⁻¹, since σ itself comes from
    the residuals. To it come ``scale_sigma`` and the calibration's covariance where they are stated. Of rank
    5 where ‖t‖ is given and taken as exact."""
    points_covariance: FloatArray
    """(n, 3, 3) likewise of each point; NaN for a rejected match."""
    inliers: BoolArray
    """(n,) the matches that the estimate rests on."""
    rms_px: float
    """Root mean square distance between pixel and projection over both images of the inliers [px]."""
    noise_px: float
    """σ of one pixel coordinate, from the residuals: √(Σr²/(n − 5)) [px]; where each point's noise is stated,
    of one of the median noise."""
    residuals_px: FloatArray
    """(n, 4) projection minus pixel, (u, v) in the initial and (u, v) in the goal image [px]."""
    seconds: float
    """Wall time of the estimation [s]."""
    scale_sigma: float = 0.0
    """Standard deviation of the scale over the scale: the one common factor of t and of every point."""
    uncertainty: JointUncertainty | None = None
    """Joint law of motion and structure, the scale aside; None where there is no pose, and in files written
    before there was one."""
    camera: CentralModel | None = None
    """that took both images, where the estimate is kept for planning; None: not said"""
    alternatives: tuple[RigidTransform, ...] = ()
    """the two motions where the status is "ambiguous", the likelier or that of more matches first, ‖t‖ = 1"""

    def __repr__(self) -> str:
        words = [self.status, f"{int(self.inliers.sum())} of {self.inliers.size} points"]
        if self.initial_T_goal is not None:
            words += [f"{self.rms_px:.3g} px rms", "metric" if self.is_metric else "of unknown scale"]
        return f"TwoViewEstimate({', '.join(words)})"

    def _repr_html_(self) -> str:
        return str(drawn("value_html", self))

    def plot(self) -> Figure:
        """Return a Matplotlib figure of motion and structure with their uncertainty.

        Raises:
            InputError: the estimate has no pose.
        """
        return cast("Figure", drawn("estimate_figure", self))

    @classmethod
    def without_pose(
        cls,
        n: int,
        status: Status,
        message: str,
        started: float,
        alternatives: tuple[RigidTransform, ...] = (),
    ) -> TwoViewEstimate:
        """Return the answer to n matches that hold no pose; ``started`` is a `time.perf_counter`."""
        return cls(
            status=status,
            message=message,
            initial_T_goal=None,
            points=np.full((n, 3), math.nan),
            is_metric=False,
            covariance=np.full((6, 6), math.nan),
            points_covariance=np.full((n, 3, 3), math.nan),
            inliers=np.zeros(n, dtype=np.bool_),
            rms_px=math.nan,
            noise_px=math.nan,
            residuals_px=np.full((n, 4), math.nan),
            seconds=time.perf_counter() - started,
            alternatives=alternatives,
        )

    def sample(
        self,
        rng: np.random.Generator,
        count: int,
        sources: tuple[Source, ...] = SOURCES,
        camera: CentralModel | None = None,
        rows: IntArray | None = None,
    ) -> EstimateSamples:
        """Return ``count`` equally likely motions and structures: (x + dx)(1 + ε), see `JointUncertainty`.

        Args:
            rng: where the numbers come from.
            count: how many.
            sources: what is uncertain: "noise" of the pixels, "scale", "calibration"; the rest stands still.
            camera: that took both images: where few noisy points leave curved valleys, the samples are then
                those of the likelihood; without it, of the normal law that is stretched over them.
            rows: (m,) inliers whose points alone are wanted: ``points`` is then (count, m, 3). None: all.

        Raises:
            InputError: there is no pose, no uncertainty with it, or no such source.
        """
        pose, law = self.initial_T_goal, self.uncertainty
        if pose is None or law is None:
            what = "no pose" if pose is None else "no joint uncertainty (written by an older version?)"
            raise InputError(f"estimate: status {self.status!r} with {what}; nothing can be sampled")
        if unknown := [s for s in sources if s not in SOURCES]:
            raise InputError(f"sources: {unknown[0]!r} given; legal: {', '.join(SOURCES)}")
        inliers = np.flatnonzero(self.inliers)
        chosen = np.arange(len(inliers)) if rows is None else np.searchsorted(inliers, rows)
        measured, law = law.pixel_sigma, law if rows is None else law.of_points(chosen)
        streams = rng.spawn(3)
        factor = 1.0 + self.scale_sigma * streams[0].standard_normal(count) * ("scale" in sources)
        moved, lens = law.draw_calibration(streams[1], count)
        if "calibration" not in sources:
            moved, lens = 0.0 * moved, 0.0 * lens
        repeats = 1.0
        if "noise" in sources:
            tau = law.taus(streams[2], count)
            if measured is None or camera is None:
                moved += law.draw_noise(streams[2], tau)
            else:
                unified = unified_image(camera).camera
                views = [self.points[self.inliers], pose.inv().apply(self.points[self.inliers])]
                fitted = np.concatenate([unified.project(p)[0] for p in views], axis=1)
                pixels = fitted - self.residuals_px[self.inliers]
                matches = Matches.of_pixels(unified, pixels, measured)
                drawn, repeats = likelihood_samples(matches, pose, views[0], law, tau, streams[2], chosen)
                moved += drawn
        seen = factor[:, None, None] * (self.points[inliers[chosen]] + moved[:, 6:].reshape(count, -1, 3))
        points = seen
        if rows is None:
            points = np.full((count, *self.points.shape), math.nan)
            points[:, inliers] = seen
        translation = factor[:, None] * (pose.translation + moved[:, :3])
        rotation = pose.rotation * Rotation.from_rotvec(moved[:, 3:6])
        return EstimateSamples(RigidTransform.from_components(translation, rotation), points, lens, repeats)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers; NaN becomes None. See :meth:`from_dict`."""
        return {
            "format": FORMAT,
            "status": self.status,
            "message": self.message,
            "goal": None if self.initial_T_goal is None else pose_fields(self.initial_T_goal),
            "points": _to_lists(self.points),
            "is_metric": self.is_metric,
            "covariance": _to_lists(self.covariance),
            "points_covariance": _to_lists(self.points_covariance),
            "inliers": [bool(x) for x in self.inliers],
            "rms_px": _to_lists(self.rms_px),
            "noise_px": _to_lists(self.noise_px),
            "residuals_px": _to_lists(self.residuals_px),
            "seconds": self.seconds,
            "alternatives": [pose_fields(pose) for pose in self.alternatives],
            "scale_sigma": self.scale_sigma,
            "uncertainty": None if self.uncertainty is None else self.uncertainty.to_dict(),
            "camera": None if self.camera is None else self.camera.to_dict(),
        }

    @classmethod
    def from_dict(cls, fields: Any, source: str = "estimate") -> TwoViewEstimate:
        """Return the estimate of :meth:`to_dict`; ``source`` stands first in messages.

        Raises:
            InputError: another format, an unknown or missing field, or a value that is not legal.
        """
        _check_fields(fields, source)
        status = fields["status"]
        if status not in STATUSES:
            raise InputError(f"{source}: status: {status!r} given; legal: {', '.join(STATUSES)}")
        if (fields["goal"] is not None) != (status == "ok"):
            raise InputError(
                f'{source}: goal: must be given if, and only if, status is "ok"; it is {status!r}'
            )
        for name, kind in (("message", str), ("is_metric", bool), ("inliers", list)):
            if not isinstance(fields[name], kind):
                raise InputError(f"{source}: {name}: {fields[name]!r} given; a {kind.__name__} is needed")
        if not all(isinstance(x, bool) for x in fields["inliers"]):
            raise InputError(f"{source}: inliers: true or false is needed for each match")
        n = len(fields["inliers"])
        law, camera = fields.get("uncertainty"), fields.get("camera")
        return cls(
            status=cast(Status, status),
            message=fields["message"],
            initial_T_goal=_read_pose(fields["goal"], f"{source}: goal"),
            points=_read_array(fields["points"], (n, 3), f"{source}: points"),
            is_metric=fields["is_metric"],
            covariance=_read_array(fields["covariance"], (6, 6), f"{source}: covariance"),
            points_covariance=_read_array(
                fields["points_covariance"], (n, 3, 3), f"{source}: points_covariance"
            ),
            inliers=np.array(fields["inliers"], dtype=np.bool_),
            rms_px=float(_read_array(fields["rms_px"], (), f"{source}: rms_px")),
            noise_px=float(_read_array(fields["noise_px"], (), f"{source}: noise_px")),
            residuals_px=_read_array(fields["residuals_px"], (n, 4), f"{source}: residuals_px"),
            seconds=finite_number(f"{source}: seconds", fields["seconds"], minimum=0.0),
            scale_sigma=finite_number(f"{source}: scale_sigma", fields.get("scale_sigma", 0.0), minimum=0.0),
            uncertainty=None
            if law is None
            else JointUncertainty.from_dict(law, sum(fields["inliers"]), f"{source}: uncertainty"),
            camera=None if camera is None else camera_from_dict(camera, f"{source}: camera"),
            alternatives=_read_poses(fields.get("alternatives", []), f"{source}: alternatives"),
        )

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the estimate as JSON, whole or not at all.

        Raises:
            InputError: the file exists and ``force`` is False, or cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n", force=force)

    @classmethod
    def load(cls, path: str | Path) -> TwoViewEstimate:
        """Return the estimate that :meth:`save` wrote, of at most `LARGEST_FILE` bytes: some 1000 matches.

        Raises:
            InputError: no such file, or not an estimate; see :meth:`from_dict`.
        """
        return cls.from_dict(parse_document(read_text(path, max_bytes=LARGEST_FILE), str(path)), str(path))


def _to_lists(value: Any) -> Any:
    """Return nested lists of floats with None for NaN."""
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        return None if math.isnan(float(array)) else float(array)
    return [_to_lists(row) for row in array]


def _check_fields(fields: Any, source: str) -> None:
    if not isinstance(fields, dict):
        raise InputError(f"{source}: {type(fields).__name__} given; a mapping of fields is needed")
    if fields.get("format") != FORMAT:
        raise InputError(f"{source}: format: {fields.get('format')!r} given; legal: {FORMAT!r}")
    if wrong := sorted(map(str, (set(fields) | _ADDED) ^ _FIELDS)):
        kind = "unknown" if wrong[0] in fields else "missing"
        raise InputError(f"{source}: {wrong[0]}: {kind} field; the fields are {', '.join(sorted(_FIELDS))}")


def _read_array(value: Any, shape: tuple[int, ...], source: str) -> FloatArray:
    """Return an array of the shape, None read as NaN."""
    try:
        given = np.array(value, dtype=object)  # NumPy would take true and "1" for numbers
        if not all(x is None or (isinstance(x, Real) and not isinstance(x, bool)) for x in given.flat):
            raise TypeError
        array = given.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{source}: an array of numbers of shape {shape} is needed") from None
    if array.shape != shape and array.size + math.prod(shape) > 0:
        raise InputError(f"{source}: shape {array.shape} given; {shape} is needed")
    if np.isinf(array).any():
        raise InputError(f"{source}: infinity given; every number must be finite")
    return owned(array.reshape(shape))


def _read_poses(poses: Any, source: str) -> tuple[RigidTransform, ...]:
    if not isinstance(poses, list):
        raise InputError(f"{source}: {type(poses).__name__} given; a list of poses is needed")
    read = (_read_pose(pose, f"{source}: {k}") for k, pose in enumerate(poses))
    return tuple(pose for pose in read if pose is not None)


def _read_pose(goal: Any, source: str) -> RigidTransform | None:
    if goal is None:
        return None
    if not isinstance(goal, dict) or set(goal) != {"translation", "quaternion"}:
        raise InputError(f"{source}: exactly the fields translation and quaternion are needed")
    translation = finite_array(f"{source}: translation", goal["translation"], (3,))
    quaternion = finite_array(f"{source}: quaternion", goal["quaternion"], (4,))
    norm = math.hypot(*quaternion)
    if abs(norm - 1.0) > 1e-6:
        raise InputError(f"{source}: quaternion: norm {norm:g} given; 1 within 1e-6 is needed")
    return RigidTransform.from_components(translation, Rotation.from_quat(quaternion))
