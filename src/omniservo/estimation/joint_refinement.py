"""Joint refinement of motion and structure, s = (s_R, s_t, s_h₁ … s_hₙ), (13)-(22), on pixels.

The unknowns minimise Σⱼ ‖π(hⱼ) − pⱼ‖² + ‖π(Rᵀ(hⱼ − t)) − pⱼ*‖². π is the real camera (the default cost) or
the perspective camera of the virtual plane, and then this is (19). Levenberg-Marquardt; the points are
eliminated by their 3×3 blocks (Schur complement), so a step costs O(n).
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import project_point, project_point_jacobian
from omniservo.estimation.pose_refinement import pose_rows
from omniservo.estimation.rotation_parameters import (
    QUATERNION,
    parameters_from_rotation,
    rotation_differential,
    rotation_from_parameters,
)
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

FIRST_DAMPING = 1e-3
LARGEST_DAMPING = 1e8
TRUSTED_DAMPING = 1e-2
"""A small gain says that the minimum is near only where damping did not make it small."""

FARTHEST = 1e6
"""Distance at which a point stands still, in lengths of the translation: at infinity for every camera."""

LEAST_PIVOT = 1e-13


class NormalBlocks(NamedTuple):
    """The normal equations in (dt, δ; dh₁ … dhₙ), block by block."""

    motion: FloatArray
    """(6, 6), lower triangle"""
    motion_gradient: FloatArray
    """(6,)"""
    points: FloatArray
    """(n, 6): xx, xy, yy, xz, yz, zz of each point's block"""
    mixed: FloatArray
    """(n, 18): each point's 6×3 block, row by row"""
    point_gradients: FloatArray
    """(n, 3)"""


@kernel
def refine_jointly(
    parameters: FloatArray,
    pixels: FloatArray,
    kind: int,
    loss_scale: float,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    most_steps: int,
) -> tuple[float, bool]:
    """Refine ``rotation`` (3, 3), ``translation`` (3,), ``points`` (n, 3) in place; return (cost, converged).

    ``parameters`` are the camera's, ``pixels`` (n, 4) [px] hold initial and goal, ``kind`` chooses s_R,
    ``loss_scale`` is c [px] of the Cauchy loss c² log(1 + r²/c²) on a point's four residuals r (infinite:
    least squares), ``most_steps`` counts accepted and rejected steps. ‖t‖ is set to 1, the points with it.

    Two directions do not change the cost: the common scale of t and h, and ‖s_R‖ of a quaternion. A penalty
    on them holds the step still there and moves nothing else. Distances are stepped in 1/‖h‖, so a point
    of little parallax can go far away but never through the camera.
    """
    n = points.shape[0]
    blocks = NormalBlocks(
        np.empty((6, 6)), np.empty(6), np.empty((n, 6)), np.empty((n, 18)), np.empty((n, 3))
    )
    s = parameters_from_rotation(kind, rotation)
    step, point_steps = np.empty(7), np.empty((n, 3))
    trial_s, trial_r, trial_t, trial_h = s.copy(), np.empty((3, 3)), np.empty(3), np.empty((n, 3))
    _unit_translation(translation, points)
    cost = linearise(parameters, pixels, loss_scale, rotation, translation, points, blocks)
    damping = FIRST_DAMPING
    for _ in range(most_steps):
        if not cost < math.inf or damping > LARGEST_DAMPING:
            break
        decrement = _solve_step(kind, s, translation, damping, blocks, step, point_steps)
        if not decrement >= 0.0:
            damping *= 10.0
            continue
        for i in range(s.shape[0]):
            trial_s[i] = s[i] + step[3 + i]
        for i in range(3):
            trial_t[i] = translation[i] + step[i]
        rotation_from_parameters(kind, trial_s, trial_r)
        _move_points(points, point_steps, trial_h)
        trial = two_view_cost(parameters, pixels, loss_scale, trial_r, trial_t, trial_h)
        # Below this the cost is rounding; the step is as good as the answer.
        last = decrement <= 1e-10 * cost + 1e-20 * n and damping <= TRUSTED_DAMPING
        if trial > cost and not (last and trial < math.inf):
            damping = max(10.0 * damping, 1e-8)
            continue
        _accept(kind, trial_s, trial_r, trial_t, trial_h, s, rotation, translation, points)
        if last:
            return trial, True
        damping = max(0.1 * damping, 1e-12)
        cost = linearise(parameters, pixels, loss_scale, rotation, translation, points, blocks)
    return cost, False


@kernel
def _accept(
    kind: int,
    trial_s: FloatArray,
    trial_r: FloatArray,
    trial_t: FloatArray,
    trial_h: FloatArray,
    s: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
) -> None:
    """Copy the trial, with ‖t‖ and a quaternion's length set to 1: neither changes the cost."""
    norm = 1.0
    if kind == QUATERNION:
        norm = math.sqrt(trial_s[0] ** 2 + trial_s[1] ** 2 + trial_s[2] ** 2 + trial_s[3] ** 2)
    for i in range(s.shape[0]):
        s[i] = trial_s[i] / norm
    for i in range(3):
        translation[i] = trial_t[i]
        for k in range(3):
            rotation[i, k] = trial_r[i, k]
        for j in range(points.shape[0]):
            points[j, i] = trial_h[j, i]
    _unit_translation(translation, points)


@kernel
def two_view_cost(
    parameters: FloatArray,
    pixels: FloatArray,
    loss_scale: float,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
) -> float:
    """Return the cost [px²] that :func:`refine_jointly` minimises; infinity outside the domain."""
    cost = 0.0
    r = rotation
    for j in range(points.shape[0]):
        x, y, z = points[j, 0], points[j, 1], points[j, 2]
        u, v, ok = project_point(parameters, x, y, z)
        if not ok:
            return math.inf
        error = (u - pixels[j, 0]) ** 2 + (v - pixels[j, 1]) ** 2
        x, y, z = x - translation[0], y - translation[1], z - translation[2]
        u, v, ok = project_point(
            parameters,
            r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
            r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
            r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
        )
        if not ok:
            return math.inf
        error += (u - pixels[j, 2]) ** 2 + (v - pixels[j, 3]) ** 2
        cost += _loss(error, loss_scale)
    return cost


@kernel
def write_residuals(
    parameters: FloatArray,
    pixels: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    residuals: FloatArray,
) -> None:
    """Write projection minus pixel (n, 4) [px]; NaN for a point that is NaN or outside the domain."""
    r = rotation
    for j in range(points.shape[0]):
        x, y, z = points[j, 0], points[j, 1], points[j, 2]
        u, v, ok = project_point(parameters, x, y, z)
        x, y, z = x - translation[0], y - translation[1], z - translation[2]
        u_goal, v_goal, ok_goal = project_point(
            parameters,
            r[0, 0] * x + r[1, 0] * y + r[2, 0] * z,
            r[0, 1] * x + r[1, 1] * y + r[2, 1] * z,
            r[0, 2] * x + r[1, 2] * y + r[2, 2] * z,
        )
        if ok and ok_goal:
            residuals[j, 0], residuals[j, 1] = u - pixels[j, 0], v - pixels[j, 1]
            residuals[j, 2], residuals[j, 3] = u_goal - pixels[j, 2], v_goal - pixels[j, 3]
        else:
            for i in range(4):
                residuals[j, i] = math.nan


@kernel
def _loss(error: float, scale: float) -> float:
    """Return the Cauchy loss of a squared residual [px²]."""
    if scale == math.inf:
        return error
    return scale * scale * math.log1p(error / (scale * scale))


@kernel
def linearise_point(
    parameters: FloatArray,
    pixels: FloatArray,
    j: int,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    to_point: FloatArray,
    to_motion: FloatArray,
    residual: FloatArray,
) -> bool:
    """Fill point ``j``'s residual (4,), its derivative to h (4, 3) and, goal rows only, to (dt, δ) (2, 6).

    δ is the rotation vector applied on the right of R. Returns False outside the camera's domain.
    """
    r = rotation
    x, y, z = points[j, 0], points[j, 1], points[j, 2]
    u, v, j00, j01, j02, j10, j11, j12, ok = project_point_jacobian(parameters, x, y, z)
    if not ok:
        return False
    residual[0], residual[1] = u - pixels[j, 0], v - pixels[j, 1]
    to_point[0, 0], to_point[0, 1], to_point[0, 2] = j00, j01, j02
    to_point[1, 0], to_point[1, 1], to_point[1, 2] = j10, j11, j12
    x, y, z = x - translation[0], y - translation[1], z - translation[2]
    cx = r[0, 0] * x + r[1, 0] * y + r[2, 0] * z
    cy = r[0, 1] * x + r[1, 1] * y + r[2, 1] * z
    cz = r[0, 2] * x + r[1, 2] * y + r[2, 2] * z
    u, v, j00, j01, j02, j10, j11, j12, ok = project_point_jacobian(parameters, cx, cy, cz)
    if not ok:
        return False
    residual[2], residual[3] = u - pixels[j, 2], v - pixels[j, 3]
    pose_rows(to_motion, 0, r, cx, cy, cz, j00, j01, j02)
    pose_rows(to_motion, 1, r, cx, cy, cz, j10, j11, j12)
    for k in range(3):
        to_point[2, k] = -to_motion[0, k]
        to_point[3, k] = -to_motion[1, k]
    return True


@kernel
def linearise(
    parameters: FloatArray,
    pixels: FloatArray,
    loss_scale: float,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    blocks: NormalBlocks,
) -> float:
    """Fill the blocks of the normal equations and return the cost, or infinity outside the domain."""
    b4, a2, e = np.empty((4, 3)), np.empty((2, 6)), np.empty(4)
    blocks.motion[:, :] = 0.0
    blocks.motion_gradient[:] = 0.0
    cost = 0.0
    for j in range(points.shape[0]):
        if not linearise_point(parameters, pixels, j, rotation, translation, points, b4, a2, e):
            return math.inf
        error = e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]
        cost += _loss(error, loss_scale)
        weight = 1.0 if loss_scale == math.inf else 1.0 / (1.0 + error / (loss_scale * loss_scale))
        place = 0
        for a in range(3):
            x, y, z, w = weight * b4[0, a], weight * b4[1, a], weight * b4[2, a], weight * b4[3, a]
            blocks.point_gradients[j, a] = x * e[0] + y * e[1] + z * e[2] + w * e[3]
            for b in range(a + 1):
                blocks.points[j, place] = x * b4[0, b] + y * b4[1, b] + z * b4[2, b] + w * b4[3, b]
                place += 1
        for a in range(6):
            x, y = weight * a2[0, a], weight * a2[1, a]
            blocks.motion_gradient[a] += x * e[2] + y * e[3]
            for b in range(a + 1):
                blocks.motion[a, b] += x * a2[0, b] + y * a2[1, b]
            for b in range(3):
                blocks.mixed[j, 3 * a + b] = x * b4[2, b] + y * b4[3, b]
    return cost


@kernel
def invert_point_block(block: FloatArray, damping: float, inverse: FloatArray) -> bool:
    """Write the inverse (6,), same order, of a point block (6,) with its diagonal times (1 + damping)."""
    xx, yy, zz = (1.0 + damping) * block[0], (1.0 + damping) * block[2], (1.0 + damping) * block[5]
    xy, xz, yz = block[1], block[3], block[4]
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * a + xy * b + xz * c
    if not determinant > 1e-15 * xx * yy * zz:
        return False
    f = 1.0 / determinant
    inverse[0], inverse[1], inverse[3] = f * a, f * b, f * c
    inverse[2], inverse[4], inverse[5] = (
        f * (xx * zz - xz * xz),
        f * (xy * xz - xx * yz),
        f * (xx * yy - xy * xy),
    )
    return True


@kernel
def eliminate_point(inverse: FloatArray, mixed: FloatArray, product: FloatArray) -> None:
    """Write the product (18,), a 6×3 block row by row, of a mixed block and an inverted point block."""
    for a in range(6):
        x, y, z = mixed[3 * a], mixed[3 * a + 1], mixed[3 * a + 2]
        product[3 * a] = x * inverse[0] + y * inverse[1] + z * inverse[3]
        product[3 * a + 1] = x * inverse[1] + y * inverse[2] + z * inverse[4]
        product[3 * a + 2] = x * inverse[3] + y * inverse[4] + z * inverse[5]


@kernel
def _solve_step(
    kind: int,
    s: FloatArray,
    translation: FloatArray,
    damping: float,
    blocks: NormalBlocks,
    step: FloatArray,
    point_steps: FloatArray,
) -> float:
    """Write the damped step (ds_t, ds_R) and dh; return −gradient·step, or −1 if singular."""
    reduced, gradient, inverse, product = np.empty((6, 6)), np.empty(6), np.empty(6), np.empty(18)
    for a in range(6):
        gradient[a] = blocks.motion_gradient[a]
        for b in range(a + 1):
            reduced[a, b] = blocks.motion[a, b]
    for j in range(blocks.points.shape[0]):
        if not invert_point_block(blocks.points[j], damping, inverse):
            return -1.0
        mixed = blocks.mixed[j]
        eliminate_point(inverse, mixed, product)
        gx, gy, gz = blocks.point_gradients[j, 0], blocks.point_gradients[j, 1], blocks.point_gradients[j, 2]
        for a in range(6):
            x, y, z = product[3 * a], product[3 * a + 1], product[3 * a + 2]
            gradient[a] -= x * gx + y * gy + z * gz
            for b in range(a + 1):
                reduced[a, b] -= x * mixed[3 * b] + y * mixed[3 * b + 1] + z * mixed[3 * b + 2]
    tangent = np.empty(6)
    if not _solve_motion(kind, s, translation, damping, blocks.motion, reduced, gradient, step, tangent):
        return -1.0
    decrement = 0.0
    for a in range(6):
        decrement -= blocks.motion_gradient[a] * tangent[a]
    for j in range(blocks.points.shape[0]):
        decrement += _solve_point(blocks, j, damping, tangent, inverse, point_steps)
    return decrement


@kernel
def _solve_point(
    blocks: NormalBlocks,
    j: int,
    damping: float,
    tangent: FloatArray,
    inverse: FloatArray,
    point_steps: FloatArray,
) -> float:
    """Write point ``j``'s step that belongs to the motion's step ``tangent``; return −gradient·step."""
    invert_point_block(blocks.points[j], damping, inverse)
    gx, gy, gz = blocks.point_gradients[j, 0], blocks.point_gradients[j, 1], blocks.point_gradients[j, 2]
    x, y, z = -gx, -gy, -gz
    for a in range(6):
        x -= blocks.mixed[j, 3 * a] * tangent[a]
        y -= blocks.mixed[j, 3 * a + 1] * tangent[a]
        z -= blocks.mixed[j, 3 * a + 2] * tangent[a]
    dx = inverse[0] * x + inverse[1] * y + inverse[3] * z
    dy = inverse[1] * x + inverse[2] * y + inverse[4] * z
    dz = inverse[3] * x + inverse[4] * y + inverse[5] * z
    point_steps[j, 0], point_steps[j, 1], point_steps[j, 2] = dx, dy, dz
    decrement: float = -(gx * dx + gy * dy + gz * dz)
    return decrement


@kernel
def _solve_motion(
    kind: int,
    s: FloatArray,
    translation: FloatArray,
    damping: float,
    motion_block: FloatArray,
    reduced: FloatArray,
    gradient: FloatArray,
    step: FloatArray,
    tangent: FloatArray,
) -> bool:
    """Solve the reduced system in the parameters (s_t, s_R); write the step (7,) and (dt, δ) (6,)."""
    size = 7 if kind == QUATERNION else 6
    differential = np.zeros((3, 4))
    rotation_differential(kind, s, differential)
    chain = np.zeros((6, 7))
    for i in range(3):
        chain[i, i] = 1.0
        for k in range(size - 3):
            chain[3 + i, 3 + k] = differential[i, k]
    system, damped = np.zeros((7, 7)), np.zeros(7)
    for a in range(6):
        for b in range(6):
            value = reduced[a, b] if b <= a else reduced[b, a]
            whole = motion_block[a, b] if b <= a else motion_block[b, a]
            for i in range(size):
                damped[i] += chain[a, i] * whole * chain[b, i]
                for k in range(i + 1):
                    system[i, k] += chain[a, i] * value * chain[b, k]
    # Penalties along the directions that change nothing: t for the scale, the quaternion for its length.
    for i in range(3):
        for k in range(i + 1):
            system[i, k] += (damped[0] + damped[1] + damped[2]) * translation[i] * translation[k]
    if kind == QUATERNION:
        for i in range(4):
            for k in range(i + 1):
                system[3 + i, 3 + k] += (damped[3] + damped[4] + damped[5] + damped[6]) * s[i] * s[k]
    for i in range(size):
        system[i, i] += damping * damped[i]
        step[i] = 0.0
        for a in range(6):
            step[i] -= chain[a, i] * gradient[a]
    if not factor_cholesky(system, size, LEAST_PIVOT):
        return False
    solve_factored(system, size, step)
    for a in range(6):
        tangent[a] = 0.0
        for i in range(size):
            tangent[a] += chain[a, i] * step[i]
    return True


@kernel
def _move_points(points: FloatArray, steps: FloatArray, moved: FloatArray) -> None:
    """Write h moved by dh: its direction by the part across h, its inverse distance by the part along h."""
    for j in range(points.shape[0]):
        x, y, z = points[j, 0], points[j, 1], points[j, 2]
        square = x * x + y * y + z * z
        along = (x * steps[j, 0] + y * steps[j, 1] + z * steps[j, 2]) / square
        x, y, z = x + steps[j, 0] - along * x, y + steps[j, 1] - along * y, z + steps[j, 2] - along * z
        distance = min(math.sqrt(square) / (1.0 - min(along, 0.9)), FARTHEST)
        scale = distance / math.sqrt(x * x + y * y + z * z)
        moved[j, 0], moved[j, 1], moved[j, 2] = scale * x, scale * y, scale * z


@kernel
def _unit_translation(translation: FloatArray, points: FloatArray) -> None:
    """Scale t to length 1 and every point with it: (22), with the structure's scale put right."""
    scale = 1.0 / math.sqrt(translation[0] ** 2 + translation[1] ** 2 + translation[2] ** 2)
    for i in range(3):
        translation[i] *= scale
        for j in range(points.shape[0]):
            points[j, i] *= scale
