"""The unified camera from corners: own joint adjustment from several starts, wrong views found and named."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.adjustment.calibration import Calibration, failed, timed
from omniservo.calibration.adjustment.conclude import Fit, conclude, lens_of
from omniservo.calibration.adjustment.equivalence import same_pixels
from omniservo.calibration.adjustment.held_out import LEAST_VIEWS, distortion_helps, held_out
from omniservo.calibration.adjustment.lens import (
    ALPHA,
    PLAIN,
    angles_of,
    camera_of,
    field,
    from_physical,
    is_legal,
    to_physical,
)
from omniservo.calibration.adjustment.refine import State, refine, refine_poses, residuals
from omniservo.calibration.adjustment.selection import Selection, select
from omniservo.calibration.adjustment.starts import adjusted_start, best_starts, spread
from omniservo.calibration.adjustment.views import Views, flatness, read_size, read_views
from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import FloatArray

Distortion = Literal["auto", "none", "radtan"]

_LEAST_USED = 3
_LARGEST_ERROR_PX = 3.0
_LARGEST_ERROR = 0.003
"""of the image's longer side: a median error above both is no calibration"""

_ALL = np.ones(9, dtype=np.bool_)
_DISTORTED_ALPHAS = (0.25, 0.45, 0.65)
"""where else the distorted model starts, with the pixels of the plain one: its valley in (ξ, k1) is long"""

_SIMPLE_ALPHAS = (0.0, 0.5)
"""ξ = 0 and ξ = 1: what is taken where the corners cannot tell them from the best ξ"""

_INDISTINGUISHABLE = 3.84
"""χ² of one degree of freedom at 95%: a fixed ξ may cost so many variances more …"""

_UNNOTICED_PX = 0.02
"""… or may move the pixels so little, root mean square over the field"""

Found = tuple[FloatArray, float]
"""θ and its typical error [px]"""


def calibrate_camera(
    image_points: Sequence[npt.ArrayLike],
    object_points: Sequence[npt.ArrayLike],
    image_size: Sequence[int],
    *,
    distortion: Distortion = "auto",
    camera: UnifiedCamera | None = None,
) -> Calibration:
    """Calibrate a unified camera from corners of a known target in several views.

    Camera and poses minimise Σ‖projection − corner‖² over the corners that are not found to be wrong,
    starting from
    cameras all over (ξ, focal length). Skew is 0. docs/calibration.md says what is computed.

    Args:
        image_points: one (k, 2) a view [px]; k may differ.
        object_points: one (k, 3) a view [m], in the target's frame; planar or not.
        image_size: (width, height) [px].
        distortion: "none", "radtan" (k1, k2, p1, p2), or "auto": radtan only if held-out views support it.
        camera: a start among the others, whose signs of the focal lengths (a mirror's), dead zone and mask
        are
            kept. Without it focal lengths are positive, except where a target that is not flat shows a
            mirror.

    Returns:
        A calibration whose ``status`` is "ok", or another with the reason in ``message`` and no camera.

    Raises:
        InputError: the call is wrong: lists that do not match, NaN, a corner outside the image, a camera
        of another size;
            the message names view and row.
    """
    began = time.perf_counter()
    size = read_size(image_size)
    if distortion not in ("auto", "none", "radtan"):
        raise InputError(f"distortion: {spelled(distortion)} given; legal: 'auto', 'none', 'radtan'")
    _check_camera(camera, size)
    views, useless = read_views(image_points, object_points, size)
    centred, middles = views.centred()  # about an origin far off a pose's turn and shift are alike
    try:
        result = _calibrate(centred, useless, size, distortion, camera)
    except np.linalg.LinAlgError as error:  # a singular system anywhere: the corners determine no camera
        message = f"not_converged: the corners determine no camera ({error})"
        result = failed("not_converged", message, useless, 0.0)
    to_middle = {
        int(n): RigidTransform.from_translation(-m) for n, m in zip(views.numbers, middles, strict=True)
    }
    result = replace(result, poses={n: pose * to_middle[n] for n, pose in result.poses.items()})
    return timed(result, time.perf_counter() - began)


def _calibrate(
    views: Views,
    useless: dict[int, str],
    size: tuple[int, int],
    distortion: Distortion,
    camera: UnifiedCamera | None,
) -> Calibration:
    if views.count < _LEAST_USED:
        given = views.count + len(useless)
        message = f"too_few_views: {views.count} usable of {given} given; at least 3 are needed"
        return failed("too_few_views", message, useless, 0.0, tuple(int(i) for i in views.numbers))
    found = _search(views, size, camera)
    starts = tuple((float(p[4]), float(p[0]), px) for p, px in ((to_physical(t), px) for t, px in found))
    if not found:
        message = "views_disagree: no camera gives the corners a rigid target; corners of another order?"
        return failed("views_disagree", message, useless, 0.0)
    theta, typical = found[0]
    # judged with distortion free, whatever is asked for: a corner that a better model explains is not wrong
    selection = select(views, theta, typical, _ALL)
    dropped = dict(sorted({**useless, **selection.dropped}.items()))
    selection = Selection(
        selection.views, selection.state, selection.keep, dropped, selection.dropped_corners
    )
    doubt = _disagreement(selection, views.count, size)
    if doubt:
        used = tuple(int(i) for i in selection.views.numbers)
        return failed("views_disagree", f"views_disagree: {doubt}", dropped, 0.0, used)
    return conclude(selection, _choose(selection, theta, size, distortion), size, starts, lens_of(camera))


def _disagreement(selection: Selection, given: int, size: tuple[int, int]) -> str:
    """Return why the views are not those of one camera, or ""."""
    left = selection.views.count
    if left < _LEAST_USED or 2 * left < given:
        return f"only {left} of {given} views agree on one camera"
    errors = residuals(selection.views, selection.state)[selection.keep]
    typical = float(np.median(np.hypot(errors[:, 0], errors[:, 1])))
    limit = max(_LARGEST_ERROR_PX, _LARGEST_ERROR * max(size))
    if not typical <= limit:
        return (
            f"with the camera that fits best half of the corners are more than {typical:.3g} px off; "
            f"at most {limit:.3g} px are accepted"
        )
    return ""


def _search(views: Views, size: tuple[int, int], camera: UnifiedCamera | None) -> list[Found]:
    """Return the plain cameras that the starts lead to, the best first."""
    signs: tuple[float, ...] = (1.0,)
    if camera is not None:
        signs = (np.sign(camera.fx) * np.sign(camera.fy),)
    elif not all(flatness(views.points[views.rows(i)])[2] for i in range(views.count)):
        signs = (1.0, -1.0)
    begins = best_starts(views, size, signs)
    if camera is not None:
        flip = np.sign(camera.fx)
        for theta in begins:
            theta[:2] *= flip
        given = (camera.fx, camera.fy, camera.cx, camera.cy, camera.xi, 0.0, 0.0, 0.0, 0.0)
        begins.insert(0, from_physical(given))
    found = []
    for theta in begins:
        state, typical = adjusted_start(views, theta)
        if np.isfinite(typical) and np.isfinite(state.theta).all():
            found.append((state.theta, typical))
    return sorted(found, key=lambda entry: entry[1])


def _choose(selection: Selection, start: FloatArray, size: tuple[int, int], distortion: Distortion) -> Fit:
    """Return the fit of the model that was required, or that the held-out views support."""
    views, keep = selection.views, selection.keep
    plain_start = start if selection.state.theta[5:].any() else selection.state.theta
    posed, _ = refine_poses(views, selection.state.with_theta(plain_start), scale_px=None, keep=keep)
    plain, cost, converged = refine(views, posed, PLAIN, keep=keep)
    if distortion == "none":
        errors = held_out(views, plain, PLAIN, keep)
        return Fit(plain, PLAIN, cost, converged, errors, "no distortion, as chosen")
    if distortion == "auto" and views.count < LEAST_VIEWS:
        return Fit(plain, PLAIN, cost, converged, None, distortion_helps(None, None)[1])
    bent, bent_cost, bent_converged = _distorted(selection, plain, size)
    errors = held_out(views, bent, _ALL, keep)
    if distortion == "radtan":
        return Fit(bent, _ALL, bent_cost, bent_converged, errors, "distortion, as chosen")
    without = held_out(views, plain, PLAIN, keep)
    helps, reason = distortion_helps(without, errors)
    _, seen = camera_of(bent.theta, size).project(bent.points(views)[keep])
    if helps and not (seen.all() and bent_converged):
        helps, reason = (
            False,
            f"{reason}; refused because the distorted model has no minimum, or folds within the corners",
        )
    if helps:
        return Fit(bent, _ALL, bent_cost, bent_converged, errors, reason)
    return Fit(plain, PLAIN, cost, converged, without, reason)


def _distorted(selection: Selection, plain: State, size: tuple[int, int]) -> tuple[State, float, bool]:
    """Return the best fit with distortion from several starts: on some views first, the best then on all."""
    views, keep = selection.views, selection.keep
    rays = field(plain.theta, size, float(angles_of(plain.points(views)).max()))
    thetas = [selection.state.theta, plain.theta]
    for alpha in _DISTORTED_ALPHAS:
        begin = np.array(plain.theta)
        begin[ALPHA] = alpha
        thetas.append(same_pixels(plain.theta, begin, alpha, _ALL, rays)[0])
    thetas = [theta for theta in thetas if is_legal(theta)]
    chosen = spread(views.count)
    some, kept = views.some(chosen), keep[views.rows_of(chosen)]
    best = plain, np.inf
    for theta in thetas:
        posed, _ = refine_poses(some, plain.some(chosen).with_theta(theta), scale_px=None, keep=kept)
        state, cost, _ = refine(some, posed, _ALL, keep=kept, iterations=40)
        if cost < best[1]:
            best = state, cost
    posed, _ = refine_poses(views, plain.with_theta(best[0].theta), scale_px=None, keep=keep)
    state, cost, converged = refine(views, posed, _ALL, keep=keep, iterations=200)
    simple = _simplest(selection, state, cost, rays) if converged else None
    return (state, cost, converged) if simple is None else simple


def _simplest(
    selection: Selection, best: State, cost: float, rays: FloatArray
) -> tuple[State, float, bool] | None:
    """Return the fit with ξ = 0, else with ξ = 1, that is as good as the best; None: neither.

    With distortion free, ξ may run off to where k1 and k2 are thousands, and the pixels stay the same.
    """
    views, keep = selection.views, selection.keep
    variance = cost / max(1.0, 2.0 * keep.sum() - 9.0 - 6.0 * views.count)
    free = np.array(_ALL)
    free[ALPHA] = False
    for alpha in _SIMPLE_ALPHAS:
        theta, moved = same_pixels(best.theta, best.theta, alpha, _ALL, rays)
        if not is_legal(theta):
            continue
        posed, _ = refine_poses(views, best.with_theta(theta), scale_px=None, keep=keep)
        state, more, converged = refine(views, posed, free, keep=keep)
        unnoticed = float(np.sqrt((moved**2).mean())) <= _UNNOTICED_PX
        if converged and (unnoticed or more <= cost + _INDISTINGUISHABLE * variance):
            return state, more, True
    return None


def _check_camera(camera: UnifiedCamera | None, size: tuple[int, int]) -> None:
    if camera is None:
        return
    if not isinstance(camera, UnifiedCamera):
        raise InputError(f"camera: {type(camera).__name__} given; a UnifiedCamera is needed")
    if (camera.width, camera.height) != size:
        given = f"{camera.width} × {camera.height}"
        raise InputError(f"camera: made for {given} px, image_size is {size[0]} × {size[1]}")
    if camera.skew != 0.0:
        raise InputError(f"camera: skew {camera.skew:g} given; a calibration has skew 0")
