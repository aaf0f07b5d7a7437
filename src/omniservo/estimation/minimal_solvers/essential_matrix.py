"""The eight-point algorithm on bearings: essential matrix, the four motions, cheirality, linear structure.

Two bearings b, b* of one point, seen from the initial and the goal camera, obey bᵀ E b* = 0 with
E = [t]× R for initial_T_goal = {R, t}. Bearings have no image plane, so directions past 90° are members
like any other, and cheirality asks for positive distances, not depths.
"""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point_jacobian, unproject_pixel
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import smallest_eigenvectors, symmetric_eigen

XU, XV, YU, YV, ZU, ZV, GOAL_XU, GOAL_XV, GOAL_YU, GOAL_YV, GOAL_ZU, GOAL_ZV = range(12)
"""The places of ∂b/∂(u, v) and ∂b*/∂(u*, v*) in a match's row of ``jacobians`` (n, 12), 3×2 row by row"""

FAR = 50.0
"""Distance, in lengths of t, given to a point whose rays do not meet in front of both cameras."""

PARALLEL = 1e-14
"""sin² of the angle between two rays below which they are parallel to rounding."""


@kernel
def epipolar_gram(bearings: FloatArray, weights: FloatArray, gram: FloatArray) -> None:
    """Write AᵀA (9, 9) into ``gram``; A has the row √weight (b ⊗ b*) for each point, E is read row by row.

    ``bearings`` (n, 6) holds (b, b*); ``weights`` (n,), 0 leaves a point out.
    """
    row = np.empty(9)
    gram[:, :] = 0.0
    for j in range(bearings.shape[0]):
        if weights[j] == 0.0:
            continue
        for a in range(3):
            for b in range(3):
                row[3 * a + b] = bearings[j, a] * bearings[j, 3 + b]
        for a in range(9):
            for b in range(a + 1):
                gram[a, b] += weights[j] * row[a] * row[b]
    for a in range(9):
        for b in range(a):
            gram[b, a] = gram[a, b]


@kernel
def eight_point_span(bearings: FloatArray, weights: FloatArray, span: FloatArray) -> None:
    """Write e₁ and e₂ into ``span`` (2, 3, 3): the eigenvectors of AᵀA with the two smallest eigenvalues.

    e₁ is the eight-point solution: the E of norm 1 with the least Σ w (bᵀ E b*)².
    """
    gram, vectors, values = np.empty((9, 9)), np.empty((9, 4)), np.empty(4)
    epipolar_gram(bearings, weights, gram)
    smallest_eigenvectors(gram, vectors, values)
    for k in range(2):
        for i in range(9):
            span[k, i // 3, i % 3] = vectors[i, k]


@kernel
def motion_from_essential(essential: FloatArray, rotation: FloatArray, translation: FloatArray) -> bool:
    """Write one rotation (3, 3) and unit translation (3,) of the essential matrix nearest to this one.

    With E ≈ u₁v₁ᵀ + u₂v₂ᵀ and u₃ = u₁ × u₂, v₃ = v₁ × v₂: t = ±u₃ and R = ±(u₁v₂ᵀ − u₂v₁ᵀ) + u₃v₃ᵀ.
    Returns False where the second singular value vanishes: no motion can be read from such a matrix.
    """
    square = np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            square[i, k] = (
                essential[i, 0] * essential[k, 0]
                + essential[i, 1] * essential[k, 1]
                + essential[i, 2] * essential[k, 2]
            )
    values, vectors = symmetric_eigen(square)
    if not values[1] > 1e-16 * values[2]:
        return False
    v = np.empty((3, 3))
    for k in range(2):
        scale = 1.0 / math.sqrt(values[2 - k])
        for i in range(3):
            v[i, k] = scale * (
                essential[0, i] * vectors[0, 2 - k]
                + essential[1, i] * vectors[1, 2 - k]
                + essential[2, i] * vectors[2, 2 - k]
            )
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        v[i, 2] = v[j, 0] * v[k, 1] - v[k, 0] * v[j, 1]
        translation[i] = vectors[j, 2] * vectors[k, 1] - vectors[k, 2] * vectors[j, 1]
    for i in range(3):
        for k in range(3):
            turn = vectors[i, 2] * v[k, 1] - vectors[i, 1] * v[k, 0]
            rotation[i, k] = translation[i] * v[k, 2] + turn
    return True


@leaf
def ray_distances(
    bearings: FloatArray, j: int, rotation: FloatArray, translation: FloatArray
) -> tuple[float, float]:
    """Return the distances (λ, λ*) at which λ b and t + λ* R b* come closest; infinite for parallel rays."""
    bx, by, bz = bearings[j, 0], bearings[j, 1], bearings[j, 2]
    gx, gy, gz = bearings[j, 3], bearings[j, 4], bearings[j, 5]
    dx = rotation[0, 0] * gx + rotation[0, 1] * gy + rotation[0, 2] * gz
    dy = rotation[1, 0] * gx + rotation[1, 1] * gy + rotation[1, 2] * gz
    dz = rotation[2, 0] * gx + rotation[2, 1] * gy + rotation[2, 2] * gz
    nx, ny, nz = by * dz - bz * dy, bz * dx - bx * dz, bx * dy - by * dx
    sine2 = nx * nx + ny * ny + nz * nz
    if sine2 < PARALLEL:
        return math.inf, math.inf
    tx, ty, tz = translation[0], translation[1], translation[2]
    first = ((ty * dz - tz * dy) * nx + (tz * dx - tx * dz) * ny + (tx * dy - ty * dx) * nz) / sine2
    second = ((ty * bz - tz * by) * nx + (tz * bx - tx * bz) * ny + (tx * by - ty * bx) * nz) / sine2
    return first, second


@leaf
def mark_in_front(
    bearings: FloatArray, rotation: FloatArray, translation: FloatArray, in_front: BoolArray
) -> None:
    """Write which matches' rays come closest at positive distances from both cameras, (n,)."""
    for j in range(bearings.shape[0]):
        first, second = ray_distances(bearings, j, rotation, translation)
        in_front[j] = 0.0 < first < math.inf and 0.0 < second < math.inf


@leaf
def motion_in_front(
    bearings: FloatArray,
    essential: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
) -> int:
    """Write the motion, of the four that E allows, with most points at positive distances from both cameras.

    Returns how many those are, or −1 where E has no motion.
    """
    if not motion_from_essential(essential, rotation, translation):
        return -1
    return turn_in_front(bearings, rotation, translation)


@kernel
def turn_in_front(bearings: FloatArray, rotation: FloatArray, translation: FloatArray) -> int:
    """Replace a motion by that with most points in front, of the four with the same E; return how many.

    The other rotation is R turned by half a turn about t, (2ttᵀ − I)R; t and −t share E up to its sign.
    """
    other = np.empty((3, 3))
    for k in range(3):
        along = 0.0
        for i in range(3):
            along += translation[i] * rotation[i, k]
        for i in range(3):
            other[i, k] = 2.0 * along * translation[i] - rotation[i, k]
    plus, minus = _count_in_front(bearings, rotation, translation)
    other_plus, other_minus = _count_in_front(bearings, other, translation)
    if max(other_plus, other_minus) > max(plus, minus):
        plus, minus = other_plus, other_minus
        for i in range(3):
            for k in range(3):
                rotation[i, k] = other[i, k]
    if minus > plus:
        for i in range(3):
            translation[i] = -translation[i]
    return max(plus, minus)


@leaf
def _count_in_front(bearings: FloatArray, rotation: FloatArray, translation: FloatArray) -> tuple[int, int]:
    """Return how many matches meet in front of both cameras under t and under −t."""
    plus, minus = 0, 0
    for j in range(bearings.shape[0]):
        first, second = ray_distances(bearings, j, rotation, translation)
        if first > 0.0 and second > 0.0:
            plus += 1
        elif first < 0.0 and second < 0.0:
            minus += 1
    return plus, minus


@leaf
def linear_structure(
    bearings: FloatArray, rotation: FloatArray, translation: FloatArray, points: FloatArray
) -> None:
    """Write the points (n, 3) that minimise the algebraic error ‖b × h‖² + ‖R b* × (h − t)‖².

    That minimum is the middle of the shortest link between the two rays. Where noise makes the rays meet
    behind a camera, or not at all, the point is put on its initial ray at :data:`FAR` translations.
    """
    for j in range(bearings.shape[0]):
        first, second = ray_distances(bearings, j, rotation, translation)
        if first > 0.0 and second > 0.0 and first < 1e4:
            for i in range(3):
                goal = translation[i] + second * (
                    rotation[i, 0] * bearings[j, 3]
                    + rotation[i, 1] * bearings[j, 4]
                    + rotation[i, 2] * bearings[j, 5]
                )
                points[j, i] = 0.5 * (first * bearings[j, i] + goal)
        else:
            for i in range(3):
                points[j, i] = FAR * bearings[j, i]


@leaf
def bearings_of_pixels(
    parameters: FloatArray, pixels: FloatArray, bearings: FloatArray, jacobians: FloatArray
) -> int:
    """Fill the bearings (n, 6) of the pixels (n, 4) and their derivatives (n, 12), places `XU` to `GOAL_ZV`.

    The derivative of the projection, J (2, 3), has the bearing as null vector, so that of the inverse is its
    pseudoinverse Jᵀ(JJᵀ)⁻¹. Returns −1, or the place 2j + view of the first pixel outside the domain.
    """
    for j in range(pixels.shape[0]):
        for view in range(2):
            x, y, z, ok = unproject_pixel(parameters, pixels[j, 2 * view], pixels[j, 2 * view + 1])
            if not ok:
                return 2 * j + view
            _, _, a0, a1, a2, b0, b1, b2, ok = project_point_jacobian(parameters, x, y, z)
            aa, ab, bb = a0 * a0 + a1 * a1 + a2 * a2, a0 * b0 + a1 * b1 + a2 * b2, b0 * b0 + b1 * b1 + b2 * b2
            f = 1.0 / (aa * bb - ab * ab)
            if not (ok and f < math.inf):
                return 2 * j + view
            place = 3 * view
            bearings[j, place], bearings[j, place + 1], bearings[j, place + 2] = x, y, z
            place = GOAL_XU * view
            jacobians[j, place], jacobians[j, place + 1] = f * (bb * a0 - ab * b0), f * (aa * b0 - ab * a0)
            jacobians[j, place + 2], jacobians[j, place + 3] = (
                f * (bb * a1 - ab * b1),
                f * (aa * b1 - ab * a1),
            )
            jacobians[j, place + 4], jacobians[j, place + 5] = (
                f * (bb * a2 - ab * b2),
                f * (aa * b2 - ab * a2),
            )
    return -1
