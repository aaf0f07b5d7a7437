"""What corners say about a camera, with the evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.adjustment.equivalence import SAME_PX, Equivalent
from omniservo.cameras import UnifiedCamera
from omniservo.drawn import drawn
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray

Status = Literal["ok", "too_few_views", "views_alike", "views_disagree", "not_determined", "not_converged"]

Side = Literal["-z", "+z", "both", "solid"]


@dataclass(frozen=True)
class Coverage:
    """Where in the image and in the field corners were seen."""

    image_fraction: float
    """of the image's area, inside the outline of at least one view's corners"""
    largest_angle: float
    """of a corner that is used from the optical axis [rad]"""


@dataclass(frozen=True)
class Errors:
    """Root mean square errors on views that did not help to make the camera (5 folds over views)."""

    px: float
    """between corner and projection [px]"""
    deg: float
    """between the corner's ray and the target point's [deg]"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated camera, or the reason why there is none.

    With any status but "ok", ``camera`` is None, numbers are NaN and arrays empty.
    """

    status: Status
    """"ok"; "too_few_views": fewer than three can be used; "views_alike": all targets are parallel;
    "views_disagree": no camera explains half of the views; "not_determined": the rays are uncertain by more
    than a degree; "not_converged": no minimum, or a camera that cannot see its own corners."""
    message: str
    """What was found, in words; for any status but "ok" the reason."""
    camera: UnifiedCamera | None
    """Its ``max_angle`` ends at most 3° past the outermost corner: the rest of the lens was not seen. Its
    ``deviation_px`` is the smaller of the two below: what a plan is given was seen by the same camera. Its
    ``model_error`` is what views left out show, its ``calibration_covariance`` the one below."""
    deviation_px: float
    """How far true pixels may lie from the camera's, anywhere up to ``max_angle``, with 95% confidence [px].
    The larger of the covariance's bound and twice the spread of the folds' cameras, plus the pattern
    that residuals show."""
    deviation_turned_px: float
    """The same after the best rotation of the camera's frame [px]: poses take that up."""
    rms_px: float
    """Root mean square distance between corner and projection, of the corners used [px]."""
    noise_px: float
    """σ of one coordinate of a corner, from the residuals: √(Σ‖e‖²/(2n − parameters)) [px]."""
    views_used: tuple[int, ...]
    """places in the caller's lists"""
    views_dropped: dict[int, str]
    """place in the caller's lists → why the view is not used"""
    corners_dropped: dict[int, dict[int, str]]
    """view → row → why that corner is not used, though its view is"""
    distortion: Literal["none", "radtan"]
    distortion_reason: str
    """Why there is distortion or none, with the numbers of the test."""
    parameter_names: tuple[str, ...]
    """of the covariance: fx, fy, cx, cy, xi, and k1, k2, p1, p2 where distortion is used"""
    covariance: FloatArray
    """(p, p) of those parameters, first order: independent normal noise of corners, and what an error of the
    model, alike over regions, does to them; never less than what leaving out single views shows"""
    identifiable: dict[str, bool]
    """whether each parameter is known to 1% with 99% confidence (centre, distortion: of the image's scale)"""
    equivalent: tuple[Equivalent, ...]
    """cameras with other ξ, focal length, k1 whose pixels differ by less than 0.1 px rms"""
    poses: dict[int, RigidTransform]
    """view → camera_T_target"""
    residuals: dict[int, FloatArray]
    """view → (k, 2) projection − corner [px], dropped corners included"""
    held_out: Errors | None
    """None with fewer than four views"""
    ray_angles: FloatArray
    """(m,) angles from the axis [rad]"""
    ray_deviation_deg: FloatArray
    """(m,) standard deviation of the rays there [deg], from the covariance"""
    ray_deviation_turned_deg: FloatArray
    """(m,) the same after the best rotation of the camera's frame [deg]"""
    coverage: Coverage
    starts: tuple[tuple[float, float, float], ...]
    """(ξ, fx [px], median error [px]) that each start of the search led to, best first"""
    seen_from: Side | None
    """the side of the targets' planes on which the camera was: "-z" (z points away from the viewer, as on
    OpenCV's boards), "+z", "both" (some views' corners are in mirrored order), "solid" (not planar)"""
    seconds: float

    def _repr_html_(self) -> str:
        return str(drawn("value_html", self))

    def __repr__(self) -> str:
        words = [self.status, f"{len(self.views_used)} views"]
        if self.camera is not None:
            words += [f"{self.rms_px:.3g} px rms", f"xi {self.camera.xi:.4g}, fx {self.camera.fx:.5g} px"]
        return f"Calibration({', '.join(words)})"

    @property
    def standard_deviations(self) -> FloatArray:
        """√diag(covariance), in the order of ``parameter_names``."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def mirrored(self) -> UnifiedCamera:
        """Return the camera of the mirror image: fy and p1 change sign, so that the world is reflected in y.

        Flat targets fit both equally well. It is the right one for a camera that looks into one mirror when
        ``seen_from`` says that the targets were seen from behind.

        Raises:
            InputError: there is no camera.
        """
        if self.camera is None:
            raise InputError(f"calibration: no camera to mirror: {self.message}")
        k1, k2, p1, p2 = self.camera.distortion
        fields = self.camera.to_dict()
        fields |= {"fy": -self.camera.fy, "distortion": [k1, k2, -p1, p2]}
        signs = np.array([-1.0 if name in ("fy", "p1") else 1.0 for name in self.parameter_names])
        fields["calibration_covariance"] = np.outer(signs, signs) * self.covariance
        return UnifiedCamera.from_dict(fields)

    def report(self) -> str:
        """Return the result in plain sentences, one a line."""
        lines = [self.message]
        if self.camera is not None:
            lines += [_parameters(self), self.distortion_reason, identifiability(self)]
            if self.held_out is not None:
                lines.append(
                    f"views left out: {self.held_out.px:.3g} px, {self.held_out.deg:.3g}° rms, "
                    "noise of corners included"
                )
            lines.append(_field(self))
            lines.append(f"views left out show a model error of {self.camera.model_error}")
        lines += [f"view {i} not used: {reason}" for i, reason in self.views_dropped.items()]
        for view, corners in self.corners_dropped.items():
            lines += [f"view {view}, corner {row} not used: {reason}" for row, reason in corners.items()]
        return "\n".join(lines)


def failed(
    status: Status, message: str, dropped: dict[int, str], seconds: float, used: tuple[int, ...] = ()
) -> Calibration:
    """Return the calibration that is none, with its reason."""
    empty = np.empty(0)
    return Calibration(
        status=status, message=message, camera=None, deviation_px=math.nan,
        deviation_turned_px=math.nan, rms_px=math.nan,
        noise_px=math.nan, views_used=used, views_dropped=dropped, corners_dropped={}, distortion="none",
        distortion_reason="", parameter_names=(), covariance=np.empty((0, 0)), identifiable={},
        equivalent=(), poses={}, residuals={}, held_out=None, ray_angles=empty, ray_deviation_deg=empty,
        ray_deviation_turned_deg=empty,
        coverage=Coverage(math.nan, math.nan), starts=(), seen_from=None, seconds=seconds,
    )  # fmt: skip


def identifiability(calibration: Calibration) -> str:
    """Say whether ξ and the focal length are determined, and which others would do as well."""
    weak = [name for name in ("xi", "fx", "fy") if not calibration.identifiable.get(name, False)]
    ends = calibration.equivalent[:1] + calibration.equivalent[1:][-1:]
    spread = " … ".join(
        f"ξ = {e.xi:.4g}, fx = {e.fx:.5g} px, k1 = {e.k1:.4g} (rms {e.rms_px:.2g} px)" for e in ends
    )
    if len(ends) == 1:
        spread = "none with another ξ"
    alike = f"cameras whose pixels differ by less than {SAME_PX:g} px rms: {spread}"
    if not weak:
        return f"ξ and focal length are determined to 1%; {alike}"
    names = ", ".join(weak)
    return f"not identifiable: {names}; rays and pixels are determined, these numbers alone are not; {alike}"


def _parameters(calibration: Calibration) -> str:
    return ", ".join(
        f"{name} = {value} {deviation}" for name, value, deviation in spelled_parameters(calibration)
    )


def spelled_parameters(calibration: Calibration) -> list[tuple[str, str, str]]:
    """Return each parameter's name, value and standard deviation, in words with their units."""
    camera = calibration.camera
    if camera is None:
        return []
    values = (camera.fx, camera.fy, camera.cx, camera.cy, camera.xi, *camera.distortion)
    known = zip(calibration.parameter_names, values, calibration.standard_deviations, strict=False)
    units = dict.fromkeys(("fx", "fy", "cx", "cy"), " px")
    return [
        (name, f"{value:.6g}{units.get(name, '')}", f"± {deviation:.2g}{units.get(name, '')}")
        for name, value, deviation in known
    ]


def _field(calibration: Calibration) -> str:
    coverage, camera = calibration.coverage, calibration.camera
    limit = math.degrees(camera.max_angle) if camera is not None and camera.max_angle else math.nan
    worst = float(calibration.ray_deviation_deg.max(initial=0.0))
    turned = float(calibration.ray_deviation_turned_deg.max(initial=0.0))
    return (
        f"corners cover {100 * coverage.image_fraction:.0f}% of the image and reach "
        f"{math.degrees(coverage.largest_angle):.1f}° from the axis; the camera ends at {limit:.1f}°; "
        f"there its pixels are within {calibration.deviation_px:.2g} px (95%), its rays {worst:.2g}° (1σ), "
        f"{calibration.deviation_turned_px:.2g} px and {turned:.2g}° after a rotation of the whole frame"
    )


def timed(calibration: Calibration, seconds: float) -> Calibration:
    """Return the same with its wall time [s]."""
    return replace(calibration, seconds=seconds)
