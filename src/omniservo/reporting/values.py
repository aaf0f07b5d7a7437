"""Values as a notebook shows them: figures, and HTML of an image with a few numbers.

`omniservo.drawn` calls these functions by their names.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial.transform import RigidTransform

from omniservo.calibration import Calibration
from omniservo.calibration.hand_eye import HandEye
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.calibration_covariance import sigmas_in_words
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation import MultiViewEstimate, PoseEstimate, TwoViewEstimate
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.reporting.camera_field import draw_field, past_right_angle
from omniservo.reporting.estimate_figures import draw_structure
from omniservo.reporting.html import Markup, inlined, tag
from omniservo.reporting.moment_figure import draw_moment
from omniservo.reporting.path_3d import path_3d
from omniservo.reporting.run_summary import how_it_ended
from omniservo.reporting.spelling import spell, spell_bound
from omniservo.reporting.style import styled
from omniservo.reporting.view_figures import residual_figure, views_figure
from omniservo.results.run_result import RunResult

_SCALE = 57.0
"""[px] of the page for an inch of a figure"""

_FINE = 2
"""pixels of the image for one of the page: screens are fine, and letters small"""

Rows = list[tuple[str, str]]


def plan_figure(plan: Plan) -> Figure:
    """Return the moment of a plan with the least left, or of the worst violation."""
    return draw_moment(plan).figure


def field_figure(camera: CentralModel) -> Figure:
    """Return a camera's field of view over its image, with its pixels a degree and its limits."""
    unified: UnifiedCamera | None
    try:
        unified = to_unified(camera).camera
    except InputError:  # no unified camera comes near: plans cannot be made with it, drawn it can be
        unified = None
    return draw_field(camera, unified)[0].figure


def estimate_figure(estimate: TwoViewEstimate) -> Figure:
    """Return motion and structure with their uncertainty, from above and from the right.

    Raises:
        InputError: the estimate has no pose.
    """
    if estimate.initial_T_goal is None:
        raise InputError(f"estimate: status {estimate.status!r}: nothing to draw: {estimate.message}")
    with styled():
        return draw_structure(estimate).figure


def run_figure(result: RunResult) -> Figure:
    """Return the camera's path in space, planned and executed."""
    with styled():
        return path_3d(result).figure


def value_html(value: object) -> str:
    """Return a value as HTML: its name, a small image, and the numbers that matter most."""
    kind = next(known for known in _SHOWN if isinstance(value, known))
    rows, draw = _SHOWN[kind](value)
    lines = [
        tag("tr", tag("th", name, style=_NAME), tag("td", words, style="text-align:left"))
        for name, words in rows
    ]
    table = tag("table", tag("caption", tag("strong", type(value).__name__), style=_CAPTION), *lines)
    image = [] if draw is None else [_image(draw(), type(value).__name__)]
    return tag("div", table, *image, style=_SIDE_BY_SIDE).html


_SIDE_BY_SIDE = "display:flex;gap:1em;align-items:flex-start;flex-wrap:wrap"
_NAME = "text-align:left;font-weight:normal;opacity:.75"
_CAPTION = "caption-side:top;text-align:left"


def _image(figure: Figure, alternative: str) -> Markup:
    """Return a figure as a small image."""
    canvas: Any = FigureCanvasAgg(figure)
    with styled():
        figure.dpi = _FINE * _SCALE
        canvas.draw()
    stream = io.BytesIO()
    Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").save(stream, "webp", quality=85)
    shown = inlined(stream.getvalue(), "webp", alternative).html
    width = round(_SCALE * float(figure.get_size_inches()[0]))
    return Markup(shown.replace("<img", f'<img width="{width}" style="max-width:100%"', 1))


Shown = tuple[Rows, Callable[[], Figure] | None]


def _of_camera(camera: CentralModel) -> Shown:
    fields, error = camera.to_dict(), camera.model_error
    focal = ", ".join(f"{fields[name]:.5g}" for name in ("fx", "fy") if name in fields)
    behind = 100.0 * past_right_angle(camera)
    rows = [
        ("model", str(fields["model"]) + (f", ξ = {fields['xi']:.4g}" if "xi" in fields else "")),
        ("image", f"{camera.width} × {camera.height} px"),
        ("focal lengths", f"{focal} px" if focal else "–"),
        ("sees", f"{math.degrees(camera.usable_angle):.1f}° from its axis; {behind:.0f}% of it past 90°"),
        ("model error", "not stated (exact)" if error is None else f"{error.sigma_px:.2g} px (1σ)"),
    ]
    if isinstance(camera, UnifiedCamera) and camera.calibration_covariance is not None:
        rows.append(("parameters (1σ)", sigmas_in_words(camera.calibration_covariance)))
    return rows, lambda: field_figure(camera)


def _of_plan(plan: Plan) -> Shown:
    path, certificate = plan.path, plan.certificate
    worst = None if certificate is None or not certificate.constraints else certificate.worst
    said = spell_bound if plan.status == "certified" else spell
    rows = [
        ("status", plan.status + (f": {plan.reason}" if plan.reason else "")),
        ("clearance", said(plan.least_clearance(range(len(plan.problem.obstacles))), "m")),
        ("points to the image's limits", said(plan.least_visibility(), "px")),
        ("tightest", "–" if worst is None else f"{worst.name}, at w = {worst.w:.3f}"),
        ("degrees, time", f"{'–' if path is None else path.degrees}, {spell(plan.seconds, 's')}"),
    ]
    return rows, lambda: plan_figure(plan)


def _of_two_views(estimate: TwoViewEstimate) -> Shown:
    pose = estimate.initial_T_goal
    found = None if pose is None else _of_pose(pose, is_metric=estimate.is_metric)
    return _fitted(estimate, found, "matches used", lambda: estimate_figure(estimate))


def _of_known_points(estimate: PoseEstimate) -> Shown:
    pose = estimate.reference_T_camera
    found = None if pose is None else [*_of_pose(pose, is_metric=True), _spread(estimate.covariance)]
    return _fitted(
        estimate, found, "points used", lambda: residual_figure(estimate.residuals_px[estimate.inliers])
    )


def _fitted(
    estimate: TwoViewEstimate | PoseEstimate, pose: Rows | None, used: str, figure: Callable[[], Figure]
) -> Shown:
    """Return what is shown of a pose fitted to points; ``pose`` None: there is none, and why."""
    points = (used, f"{int(estimate.inliers.sum())} of {estimate.inliers.size}")
    if pose is None:
        return [("status", f"{estimate.status}: {estimate.message}"), points], None
    error = ("reprojection error", f"{spell(estimate.rms_px, 'px')} rms")
    return [("status", estimate.status), *pose, points, error], figure


def _of_several_views(estimate: MultiViewEstimate) -> Shown:
    joined = sum(pose is not None for pose in estimate.initial_T_views)
    rows = [
        ("status", estimate.status + (f": {estimate.message}" if estimate.message else "")),
        ("views with a pose", f"{joined} of {len(estimate.initial_T_views)}"),
        ("points", str(int(np.isfinite(estimate.points).all(axis=-1).sum()))),
        ("scale", "metric" if estimate.is_metric else "unknown"),
        ("reprojection error", f"{spell(estimate.rms_px, 'px')} rms"),
    ]
    poses = [pose for pose in estimate.initial_T_views if pose is not None]
    return rows, (lambda: views_figure(estimate.points, poses)) if joined else None


def _of_pose(pose: RigidTransform, *, is_metric: bool) -> Rows:
    unit, factor = ("mm", 1e3) if is_metric else ("(length 1: no scale)", 1.0)
    numbers = ", ".join(f"{factor * x:.4g}" for x in pose.translation.tolist())
    return [
        ("translation", f"[{numbers}] {unit}"),
        ("rotation", spell(float(pose.rotation.magnitude()), "rad")),
    ]


def _spread(covariance: FloatArray) -> tuple[str, str]:
    """Return the row of a pose's largest standard deviations."""
    sigma = np.sqrt(np.diag(covariance))
    words = f"{spell(float(sigma[:3].max()), 'm')}, {spell(float(sigma[3:].max()), 'rad')}"
    return "standard deviation", words


def _of_calibration(found: Calibration) -> Shown:
    camera, held = found.camera, found.held_out
    used = f"{len(found.views_used)} of {len(found.views_used) + len(found.views_dropped)}"
    if camera is None:
        return [("status", f"{found.status}: {found.message}"), ("views used", used)], None
    rows = [
        ("status", found.status),
        ("views used", used),
        ("reprojection error", f"{spell(found.rms_px, 'px')} rms"),
        ("on views left out", "–" if held is None else f"{spell(held.px, 'px')}, {held.deg:.3f}°"),
        ("true pixels may be off by", f"{spell(found.deviation_px, 'px')} (95%)"),
        ("camera", f"ξ = {camera.xi:.4g}, fx = {camera.fx:.5g} px"),
    ]
    return rows, lambda: field_figure(camera)


def _of_hand_eye(found: HandEye) -> Shown:
    pose = found.flange_T_camera
    if pose is None:
        return [("status", f"{found.status}: {found.message}")], None
    rows = [
        ("status", found.status),
        *_of_pose(pose, is_metric=True),
        _spread(found.covariance),
        ("views used", f"{len(found.used)} of {len(found.views)}"),
        ("board by each view alone", f"{spell(found.scatter_rms[0], 'm')} rms"),
    ]
    return rows, lambda: residual_figure(np.concatenate([view.loop_px for view in found.views if view.used]))


def _of_run(result: RunResult) -> Shown:
    metrics = result.metrics

    def number(name: str, unit: str) -> str:
        value = metrics.get(name)
        return spell(float(value) if isinstance(value, int | float) else None, unit)

    rows = [
        ("task, method", f"{result.task.name}, {result.method}"),
        ("ended", how_it_ended(metrics) if "status" in metrics else "not scored"),
        ("clearance, executed", number("clearance_executed_m", "m")),
        ("points to the image's limits, executed", number("visibility_executed_px", "px")),
        ("motion took", number("servo_seconds", "s")),
    ]
    return rows, lambda: run_figure(result)


_SHOWN: dict[type, Callable[[Any], Shown]] = {
    Plan: _of_plan,
    TwoViewEstimate: _of_two_views,
    PoseEstimate: _of_known_points,
    MultiViewEstimate: _of_several_views,
    Calibration: _of_calibration,
    HandEye: _of_hand_eye,
    RunResult: _of_run,
    CentralModel: _of_camera,
}
"""CentralModel last: whatever looks like a camera"""
