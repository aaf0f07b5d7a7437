"""One control step, compiled: pixels and the planned motion in, camera twist and evidence out.

Poses are (7,): the quaternion (x, y, z, w) and the translation of initial_T_camera [m].
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import project_point, unproject_pixel
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.servoing.control_law import LEAST_CONDITIONING, limit_twist, solve_twist
from omniservo.servoing.interaction import BEARING, LEAST_COSINE, write_feature, write_rows
from omniservo.tracking.gate import robust_pose
from omniservo.tracking.pose_filter import correct_state

DONE = 0
NOT_FINITE = 1
FEATURE_LOSS = 2
SINGULAR = 3
NO_POSE = 4
DIVERGED = 5

GAIN, LEAST_FEATURES, DIVERGENCE_PX, MAX_LINEAR, MAX_ANGULAR, GATE_PX = range(6)
"""Places in ``settings``."""

COUNT, ERROR_PX, GOAL_ERROR_PX, POSE_RMS_PX, CONDITIONING, FACTOR = range(6)
"""Places in ``evidence``; where the status is NOT_FINITE, COUNT holds the row instead."""


class Sight(NamedTuple):
    """What an image shows of n points, and what the goal image does."""

    points: FloatArray
    """(n, 3) [m] in the initial camera frame"""
    pixels: FloatArray
    """(n, 2) [px] at the exposure; ``valid`` says which rows are read"""
    valid: BoolArray
    """(n,) on return: the points used; one that the others' pose does not explain is none of them"""
    goal_pixels: FloatArray
    """(n, 2) [px] of the goal image"""


class Planned(NamedTuple):
    """The planned motion, at the exposure and when the twist acts."""

    seen: FloatArray
    """(7,) pose at the exposure"""
    now: FloatArray
    """(7,) pose when the twist acts"""
    twist: FloatArray
    """(6,) twist then, per second"""
    carried: FloatArray
    """(4, 7) poses: from the first to the second, and from the third to the fourth, the camera moves between
    the exposure and the twist's action"""
    offsets: FloatArray
    """(2, n, 3) added to the features at the exposure and when the twist acts, see `GoalBlend`"""
    growth: FloatArray
    """(n, 3) their derivative when the twist acts [1/s]"""


class Estimate(NamedTuple):
    """The pose filter's."""

    pose: FloatArray
    """(7,) in: its prediction for the exposure; out: joined with the image"""
    covariance: FloatArray
    """(6, 6) likewise"""
    residuals: FloatArray
    """(2,) of the images so far, and with this one: Σr² [px²], degrees of freedom"""
    stamp: FloatArray
    """(6,) the camera's twist at the exposure times the standard deviation of the time stamp [m, rad]"""


class StepResult(NamedTuple):
    """What a step writes."""

    pose: FloatArray
    """(7,) that explains this image alone"""
    twist: FloatArray
    """(6,) within the speed limits; zero unless the status is DONE"""
    reference_pixels: FloatArray
    """(n, 2) [px], the reference at the exposure; NaN outside the camera's domain"""
    evidence: FloatArray
    """(6,) see COUNT and the rest"""


@kernel
def track_step(
    parameters: FloatArray,
    kind: int,
    settings: FloatArray,
    sight: tuple[FloatArray, FloatArray, BoolArray, FloatArray],
    plan: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray],
    estimate: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    step: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> int:
    """Write the camera twist (6,) of (43) with depths by (44) and return the status.

    Plain tuples are handed in: to read the type of a named one takes Numba a microsecond, each time.

    Args:
        parameters: the camera's.
        kind: the feature, BEARING or VIRTUAL_PLANE.
        settings: (6,), see GAIN and the rest.
        sight: the fields of `Sight`.
        plan: the fields of `Planned`.
        estimate: the fields of `Estimate`, changed.
        step: the fields of `StepResult`, out.
    """
    image, motion, filtered, written = Sight(*sight), Planned(*plan), Estimate(*estimate), StepResult(*step)
    bearings, evidence = np.zeros(image.points.shape), written.evidence
    written.twist[:], evidence[:] = 0.0, 0.0
    status = _read_pixels(parameters, kind, settings, image, bearings, evidence)
    if status != DONE:
        return status
    seen = _see_pose(parameters, settings, image, motion.seen, filtered, written)
    if evidence[COUNT] < settings[LEAST_FEATURES]:
        return FEATURE_LOSS
    _measure_gaps(parameters, kind, image, motion, written)
    gain = settings[GAIN]
    evidence[CONDITIONING] = _solve(kind, gain, image, motion, bearings, filtered.pose, written.twist)
    return _judge(settings, seen, written.twist, evidence)


@kernel
def predict_pixels(
    parameters: FloatArray,
    points: FloatArray,
    pose: FloatArray,
    plan_seen: FloatArray,
    plan_then: FloatArray,
    pixels: FloatArray,
    valid: BoolArray,
) -> None:
    """Write where the points will be: seen from ``pose``, then carried on by the planned motion."""
    c = np.empty(3)
    moved = np.empty(3)
    for j in range(points.shape[0]):
        _into_camera(pose, points[j], c)
        _move(plan_seen, plan_then, c, moved)
        pixels[j, 0], pixels[j, 1], valid[j] = project_point(parameters, moved[0], moved[1], moved[2])


@leaf
def _judge(settings: FloatArray, seen: bool, twist: FloatArray, evidence: FloatArray) -> int:
    """Return the status, and limit the twist or set it to zero."""
    total = 0.0
    for a in range(6):
        total += abs(twist[a])
    status = DONE
    # Written so that a NaN anywhere fails.
    if not (evidence[CONDITIONING] >= LEAST_CONDITIONING and total < math.inf):
        status = SINGULAR
    elif not seen:
        status = NO_POSE
    elif not evidence[ERROR_PX] <= settings[DIVERGENCE_PX]:
        status = DIVERGED
    if status != DONE:
        twist[:] = 0.0
        return status
    evidence[FACTOR] = limit_twist(twist, settings[MAX_LINEAR], settings[MAX_ANGULAR])
    return DONE


@leaf
def _read_pixels(
    parameters: FloatArray,
    kind: int,
    settings: FloatArray,
    sight: Sight,
    bearings: FloatArray,
    evidence: FloatArray,
) -> int:
    """Unproject the valid pixels; drop those that have no feature; count."""
    pixels, valid, count = sight.pixels, sight.valid, 0
    for j in range(pixels.shape[0]):
        if not valid[j]:
            continue
        u, v = pixels[j, 0], pixels[j, 1]
        if not (math.isfinite(u) and math.isfinite(v)):
            evidence[COUNT] = j
            return NOT_FINITE
        x, y, z, ok = unproject_pixel(parameters, u, v)
        valid[j] = ok and (kind == BEARING or z > LEAST_COSINE)
        if valid[j]:
            bearings[j, 0], bearings[j, 1], bearings[j, 2] = x, y, z
            count += 1
    evidence[COUNT] = count
    return DONE if count >= settings[LEAST_FEATURES] else FEATURE_LOSS


@kernel
def _see_pose(
    parameters: FloatArray,
    settings: FloatArray,
    sight: Sight,
    plan_seen: FloatArray,
    estimate: Estimate,
    step: StepResult,
) -> bool:
    """Write the pose of this image, from the estimated one as guess or else the plan's; False: neither works.

    The estimated pose is updated with it.

    Points at the rim that the guess puts outside the camera's domain take part only where the pose of the
    others sees them. Points that it does not explain are no longer ``valid``.
    """
    points, pixels, valid, _ = sight
    c = np.empty(3)
    fit = np.empty(points.shape[0], dtype=np.bool_)
    for guess in (estimate.pose, plan_seen):
        for j in range(points.shape[0]):
            _into_camera(guess, points[j], c)
            fit[j] = valid[j] and project_point(parameters, c[0], c[1], c[2])[2]
        rms, ok = robust_pose(parameters, points, pixels, fit, valid, settings[GATE_PX], guess, step.pose)
        if ok:
            step.evidence[POSE_RMS_PX] = rms
            count = 0
            for j in range(valid.shape[0]):
                if valid[j]:
                    count += 1
            step.evidence[COUNT] = count
            filtered = estimate.pose, estimate.covariance, estimate.residuals
            correct_state(parameters, points, pixels, valid, step.pose, estimate.stamp, filtered)
            return True
    return False


@kernel
def _measure_gaps(parameters: FloatArray, kind: int, sight: Sight, plan: Planned, step: StepResult) -> None:
    """Write the reference's pixels and the rms distances to them and to the goal image [px].

    A point whose reference lies outside the camera's domain counts in the second alone.
    """
    points, pixels, valid, goal_pixels = sight
    reference_pixels, evidence = step.reference_pixels, step.evidence
    c = np.empty(3)
    s = np.empty(3)
    total = 0.0
    count = 0
    goal_total = 0.0
    for j in range(points.shape[0]):
        _into_camera(plan.seen, points[j], c)
        write_feature(kind, c[0], c[1], c[2], s)
        for a in range(3):
            s[a] += plan.offsets[0, j, a]
        u, v, ok = project_point(parameters, s[0], s[1], s[2] if kind == BEARING else 1.0)
        reference_pixels[j, 0] = u if ok else math.nan
        reference_pixels[j, 1] = v if ok else math.nan
        if valid[j]:
            goal_total += (pixels[j, 0] - goal_pixels[j, 0]) ** 2 + (pixels[j, 1] - goal_pixels[j, 1]) ** 2
            if ok:
                total += (pixels[j, 0] - u) ** 2 + (pixels[j, 1] - v) ** 2
                count += 1
    # Without any reference that the camera could see the plan does not hold here.
    evidence[ERROR_PX] = math.sqrt(total / count) if count > 0 else math.inf
    evidence[GOAL_ERROR_PX] = math.sqrt(goal_total / evidence[COUNT])


@kernel
def _solve(
    kind: int,
    gain: float,
    sight: Sight,
    plan: Planned,
    bearings: FloatArray,
    pose: FloatArray,
    twist: FloatArray,
) -> float:
    """Write the twist that solves the equations of all valid points when it acts; return their conditioning.

    A point lies where its bearing was seen, at the distance (44), carried on by the camera's motion since.
    """
    points = sight.points
    rows, target = np.zeros((3 * len(points), 6)), np.zeros(3 * len(points))
    c = np.empty(3)
    planned = np.empty(3)
    between = np.empty(3)
    now = np.empty(3)
    for j in range(points.shape[0]):
        if not sight.valid[j]:
            continue
        _into_camera(pose, points[j], c)
        distance = math.sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2])
        for a in range(3):
            c[a] = distance * bearings[j, a]
        _move(plan.carried[0], plan.carried[1], c, between)
        _move(plan.carried[2], plan.carried[3], between, now)
        _into_camera(plan.now, points[j], planned)
        own = slice(3 * j, 3 * j + 3)
        _write_equations(kind, gain, plan, j, now, planned, rows[own], target[own])
    return solve_twist(rows, target, twist)


@kernel
def _write_equations(
    kind: int,
    gain: float,
    plan: Planned,
    j: int,
    now: FloatArray,
    planned: FloatArray,
    rows: FloatArray,
    target: FloatArray,
) -> None:
    """Write L̂ (3, 6) and (∂s*/∂w) ẇ − λ₂ (s − s*) (3,) of point j; zeros where a feature does not exist."""
    flow = np.empty((3, 6))
    s = np.empty(3)
    reference = np.empty(3)
    exists = write_feature(kind, now[0], now[1], now[2], s)
    exists = write_feature(kind, planned[0], planned[1], planned[2], reference) and exists
    if not exists:
        return
    write_rows(kind, now[0], now[1], now[2], rows)
    write_rows(kind, planned[0], planned[1], planned[2], flow)
    for a in range(3):
        change = plan.growth[j, a]
        for b in range(6):
            change += flow[a, b] * plan.twist[b]
        target[a] = change - gain * (s[a] - reference[a] - plan.offsets[1, j, a])


@leaf
def _into_camera(pose: FloatArray, point: FloatArray, c: FloatArray) -> None:
    """Write c = Rᵀ(h − t), (44) with the transpose where the paper prints R."""
    x, y, z = point[0] - pose[4], point[1] - pose[5], point[2] - pose[6]
    _rotate(-pose[0], -pose[1], -pose[2], pose[3], x, y, z, c)


@kernel
def _move(before: FloatArray, after: FloatArray, point: FloatArray, moved: FloatArray) -> None:
    """Write the coordinates in camera pose ``after`` of a point given in camera pose ``before``."""
    h = np.empty(3)
    _rotate(before[0], before[1], before[2], before[3], point[0], point[1], point[2], h)
    for a in range(3):
        h[a] += before[4 + a]
    _into_camera(after, h, moved)


@leaf
def _rotate(
    qx: float, qy: float, qz: float, qw: float, x: float, y: float, z: float, out: FloatArray
) -> None:
    """Write R(q) (x, y, z) for the unit quaternion q: p + 2w(q×p) + 2 q×(q×p)."""
    ax, ay, az = 2.0 * (qy * z - qz * y), 2.0 * (qz * x - qx * z), 2.0 * (qx * y - qy * x)
    out[0] = x + qw * ax + qy * az - qz * ay
    out[1] = y + qw * ay + qz * ax - qx * az
    out[2] = z + qw * az + qx * ay - qy * ax
