"""Joint refinement of motion and structure, s = (s_R, s_t, s_h₁ … s_hₙ), (13)-(22), on pixels.

The unknowns minimise Σⱼ wⱼ²‖π(hⱼ) − pⱼ‖² + wⱼ*²‖π(Rᵀ(hⱼ − t)) − pⱼ*‖². π is the real camera (the default
cost) or the perspective camera of the virtual plane, and then this is (19); w is 1 where nothing is known of
the pixels' noise. Levenberg-Marquardt; the points are
eliminated by their 3×3 blocks (Schur complement), so a step costs O(n).
"""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point
from omniservo.estimation.refinement.normal_blocks import (
    NormalBlocks,
    eliminate_point,
    empty_blocks,
    invert_point_block,
    linearise,
)
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored
from omniservo.geometry.matrix_products import transposed_times
from omniservo.geometry.quaternions import (
    QUATERNION,
    parameters_from_rotation,
    rotation_differential,
    rotation_from_parameters,
)

FIRST_DAMPING = 1e-6
LARGEST_DAMPING = 1e8
TRUSTED_DAMPING = 1e-2
"""A small gain says that the minimum is near only where damping did not make it small."""

FARTHEST = 1e6
"""Distance at which a point stands still, in lengths of the translation: at infinity for every camera."""

LEAST_PIVOT = 1e-13


@kernel
def refine_jointly(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    kind: int,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    most_steps: int,
) -> tuple[float, bool]:
    """Refine ``rotation`` (3, 3), ``translation`` (3,), ``points`` (n, 3) in place; return (cost, converged).

    ``parameters`` are the camera's, ``pixels`` (n, 4) [px] hold initial and goal, ``weights`` (n, 2) their w,
    ``kind`` chooses s_R, ``most_steps`` counts accepted and rejected steps. ‖t‖ is set to 1, and the points
    with it.

    Two directions do not change the cost: the common scale of t and h, and ‖s_R‖ of a quaternion. A penalty
    on them holds the step still there and moves nothing else. Distances are stepped in 1/‖h‖, so a point
    of little parallax can go far away but never through the camera.
    """
    n = points.shape[0]
    blocks, trial_blocks = empty_blocks(n), empty_blocks(n)
    s = parameters_from_rotation(kind, rotation)
    step, point_steps = np.empty(7), np.empty((n, 3))
    trial_s, trial_r, trial_t, trial_h = s.copy(), np.empty((3, 3)), np.empty(3), np.empty((n, 3))
    _unit_translation(translation, points)
    cost = linearise(parameters, pixels, weights, rotation, translation, points, blocks)
    damping = FIRST_DAMPING
    for _ in range(most_steps):
        if not cost < math.inf or damping > LARGEST_DAMPING:
            break
        decrement = _solve_step(kind, s, translation, damping, blocks, step, point_steps)
        if not decrement >= 0.0:
            damping *= 10.0
            continue
        _move_motion(kind, s, translation, step, trial_s, trial_t)
        rotation_from_parameters(kind, trial_s, trial_r)
        _move_points(points, point_steps, trial_h)
        _unit_translation(trial_t, trial_h)
        # Below this the cost is rounding; the step is as good as the answer.
        last = decrement <= 1e-9 * cost + 1e-20 * n and damping <= TRUSTED_DAMPING
        if last:
            trial = _cost(parameters, pixels, weights, trial_r, trial_t, trial_h)
        else:  # Most trials are taken, so their normal equations are made along with their cost.
            trial = linearise(parameters, pixels, weights, trial_r, trial_t, trial_h, trial_blocks)
        if trial > cost and not (last and trial < math.inf):
            damping = max(10.0 * damping, 1e-8)
            continue
        _accept(trial_s, trial_r, trial_t, trial_h, s, rotation, translation, points)
        if last:
            return trial, True
        damping, cost = max(0.1 * damping, 1e-12), trial
        blocks, trial_blocks = trial_blocks, blocks
    return cost, False


@kernel
def _cost(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
) -> float:
    """Return the cost [px²] alone, infinite outside the domain; see `linearise`."""
    residuals, cost = np.empty_like(pixels), 0.0
    write_residuals(parameters, pixels, rotation, translation, points, residuals)
    for j in range(points.shape[0]):
        u, v = weights[j, 0] * residuals[j, 0], weights[j, 0] * residuals[j, 1]
        u_goal, v_goal = weights[j, 1] * residuals[j, 2], weights[j, 1] * residuals[j, 3]
        error = u * u + v * v + u_goal * u_goal + v_goal * v_goal
        if not error < math.inf:
            return math.inf
        cost += error
    return cost


@leaf
def _move_motion(
    kind: int,
    s: FloatArray,
    translation: FloatArray,
    step: FloatArray,
    trial_s: FloatArray,
    trial_t: FloatArray,
) -> None:
    """Write (s_t, s_R) moved by the step (7,); a quaternion keeps its length, which the cost does not see."""
    for i in range(3):
        trial_t[i] = translation[i] + step[i]
    square = 0.0
    for i in range(s.shape[0]):
        trial_s[i] = s[i] + step[3 + i]
        square += trial_s[i] * trial_s[i]
    if kind == QUATERNION:
        norm = math.sqrt(square)
        for i in range(4):
            trial_s[i] /= norm


@leaf
def _accept(
    trial_s: FloatArray,
    trial_r: FloatArray,
    trial_t: FloatArray,
    trial_h: FloatArray,
    s: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
) -> None:
    """Copy the trial."""
    for i in range(s.shape[0]):
        s[i] = trial_s[i]
    for i in range(3):
        translation[i] = trial_t[i]
        for k in range(3):
            rotation[i, k] = trial_r[i, k]
        for j in range(points.shape[0]):
            points[j, i] = trial_h[j, i]


@leaf
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
        x, y, z = transposed_times(r, x, y, z)
        u_goal, v_goal, ok_goal = project_point(parameters, x, y, z)
        if ok and ok_goal:
            residuals[j, 0], residuals[j, 1] = u - pixels[j, 0], v - pixels[j, 1]
            residuals[j, 2], residuals[j, 3] = u_goal - pixels[j, 2], v_goal - pixels[j, 3]
        else:
            for i in range(4):
                residuals[j, i] = math.nan


@leaf
def residual_sums(residuals: FloatArray, weights: FloatArray, members: BoolArray) -> tuple[float, float]:
    """Return Σ r² and Σ w²r² of the members' residuals (n, 4) [px²]."""
    plain, weighted = 0.0, 0.0
    for j in range(residuals.shape[0]):
        if members[j]:
            for view in range(2):
                square = residuals[j, 2 * view] ** 2 + residuals[j, 2 * view + 1] ** 2
                plain += square
                weighted += weights[j, view] ** 2 * square
    return plain, weighted


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
    if not _solve_motion(kind, s, translation, damping, blocks.motion, reduced, gradient, step):
        return -1.0
    tangent = gradient  # now the step in (dt, δ)
    decrement = 0.0
    for a in range(6):
        decrement -= blocks.motion_gradient[a] * tangent[a]
    for j in range(blocks.points.shape[0]):
        decrement += _solve_point(blocks, j, damping, tangent, inverse, point_steps)
    return decrement


@leaf
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
    right: FloatArray,
    step: FloatArray,
) -> bool:
    """Solve the reduced system in the parameters (s_t, s_R); write the step (7,).

    ``right`` (6,) is the reduced gradient; in its place stands the same step in (dt, δ) afterwards.
    """
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
            step[i] -= chain[a, i] * right[a]
    if not factor_cholesky(system, size, LEAST_PIVOT):
        return False
    solve_factored(system, size, step)
    for a in range(6):
        right[a] = 0.0
        for i in range(size):
            right[a] += chain[a, i] * step[i]
    return True


@leaf
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


@leaf
def _unit_translation(translation: FloatArray, points: FloatArray) -> None:
    """Scale t to length 1 and every point with it: (22), with the structure's scale put right."""
    scale = 1.0 / math.sqrt(translation[0] ** 2 + translation[1] ** 2 + translation[2] ** 2)
    for i in range(3):
        translation[i] *= scale
        for j in range(points.shape[0]):
            points[j, i] *= scale
