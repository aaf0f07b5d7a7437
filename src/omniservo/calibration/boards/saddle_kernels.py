"""The compiled part of the corner fit: damped least squares on the pixels around a crossing of edges."""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

U, V, ANGLE_1, ANGLE_2, BEND_1, BEND_2, LOG_BLUR, GREY, GREY_U, GREY_V, CONTRAST = range(11)
PARAMETERS = 11
"""A state's places: the crossing (u, v) [px], the edges' directions [rad] and curvatures [1/px], the
logarithm of their blur's σ [px], grey value a, its slope g [1/px], contrast b; see `fit_saddles`"""

_STEPS, _FEW = 20, 6
_HOPELESS = 0.5  # of the variance
_LEAST_LOG_BLUR, _MOST_LOG_BLUR = math.log(0.25), math.log(4.0)
_MOST_BEND = 0.2  # [1/px]
_FOREIGN = 1.2  # of the contrast: pixels farther from the model are something else
_NEAR = 3.0  # [px]
_DECIDED = 0.6  # of the contrast: pixels beyond belong to one quadrant


@leaf
def prepare(state: FloatArray, ready: FloatArray) -> None:
    """Write what all pixels need of the state: cosine and sine of both directions, 1/(√2 σ)."""
    ready[0], ready[1] = math.cos(state[ANGLE_1]), math.sin(state[ANGLE_1])
    ready[2], ready[3] = math.cos(state[ANGLE_2]), math.sin(state[ANGLE_2])
    ready[4] = math.exp(-state[LOG_BLUR]) / math.sqrt(2.0)


@leaf
def crossing(state: FloatArray, ready: FloatArray, x: float, y: float, slope: FloatArray) -> float:
    """Grey value at the offset (x, y); derivatives by the parameters go to ``slope``; see `fit_saddles`."""
    qx, qy = x - state[U], y - state[V]
    c1, s1, c2, s2, scale = ready[0], ready[1], ready[2], ready[3], ready[4]
    t1, t2 = c1 * qx + s1 * qy, c2 * qx + s2 * qy
    n1, n2 = c1 * qy - s1 * qx, s2 * qx - c2 * qy
    z1 = (n1 - 0.5 * state[BEND_1] * t1 * t1) * scale
    z2 = (n2 - 0.5 * state[BEND_2] * t2 * t2) * scale
    e1, e2 = math.erf(z1), math.erf(z2)
    b = state[CONTRAST]
    f1 = b * e2 * math.exp(-z1 * z1) * (2.0 / math.sqrt(math.pi))
    f2 = b * e1 * math.exp(-z2 * z2) * (2.0 / math.sqrt(math.pi))
    g1, g2 = f1 * scale, f2 * scale
    slope[U] = g1 * (s1 + state[BEND_1] * t1 * c1) + g2 * (-s2 + state[BEND_2] * t2 * c2) - state[GREY_U]
    slope[V] = g1 * (-c1 + state[BEND_1] * t1 * s1) + g2 * (c2 + state[BEND_2] * t2 * s2) - state[GREY_V]
    slope[ANGLE_1] = -g1 * (t1 + state[BEND_1] * t1 * n1)
    slope[ANGLE_2] = g2 * (t2 + state[BEND_2] * t2 * n2)
    slope[BEND_1] = -0.5 * g1 * t1 * t1
    slope[BEND_2] = -0.5 * g2 * t2 * t2
    slope[LOG_BLUR] = -f1 * z1 - f2 * z2
    slope[GREY] = 1.0
    slope[GREY_U], slope[GREY_V] = qx, qy
    slope[CONTRAST] = e1 * e2
    return float(state[GREY] + qx * state[GREY_U] + qy * state[GREY_V] + b * e1 * e2)


@leaf
def gather(
    image: ByteArray,
    start: FloatArray,
    axes: FloatArray,
    limits: FloatArray,
    seen: BoolArray,
    pixels: FloatArray,
) -> int:
    """Write offset, grey value and weight of the window's pixels into ``pixels`` (m, 4); return how many.

    ``limits``: along, across [steps], radius [px]. ``seen``: which pixels count, (0, 0) for all.
    """
    height, width = image.shape
    along, across, radius = limits[0], limits[1], limits[2]
    determinant = axes[0, 0] * axes[1, 1] - axes[0, 1] * axes[1, 0]
    side = math.ceil(radius)
    u0, v0 = round(start[0]), round(start[1])
    count = 0
    for v in range(max(v0 - side, 0), min(v0 + side + 1, height)):
        for u in range(max(u0 - side, 0), min(u0 + side + 1, width)):
            x, y = u - start[0], v - start[1]
            p = abs(axes[1, 1] * x - axes[0, 1] * y) / abs(determinant)
            q = abs(axes[0, 0] * y - axes[1, 0] * x) / abs(determinant)
            weight = min(radius + 0.5 - math.hypot(x, y), 1.0)  # a soft rim
            if max(p, q) <= along and min(p, q) <= across and weight > 0.0:
                if seen.shape[0] > 0 and not seen[v, u]:
                    continue
                pixels[count, 0], pixels[count, 1] = x, y
                pixels[count, 2], pixels[count, 3] = image[v, u], weight
                count += 1
    return count


@kernel
def cost_of(
    state: FloatArray, pixels: FloatArray, count: int, normal: FloatArray, right: FloatArray
) -> float:
    """Sum of weighted squares, with the normal equations in ``normal`` and ``right``."""
    slope, ready = np.empty(PARAMETERS), np.empty(5)
    prepare(state, ready)
    for i in range(PARAMETERS):
        right[i] = 0.0
        for j in range(i + 1):
            normal[i, j] = 0.0
    total = 0.0
    for k in range(count):
        value = crossing(state, ready, pixels[k, 0], pixels[k, 1], slope)
        off, weight = value - pixels[k, 2], pixels[k, 3]
        total += weight * off * off
        for i in range(PARAMETERS):
            part = weight * slope[i]
            right[i] -= part * off
            for j in range(i + 1):
                normal[i, j] += part * slope[j]
    return total


@kernel
def descend(state: FloatArray, pixels: FloatArray, count: int, hopeless: float) -> float:
    """Fit ``state`` in place by Levenberg and Marquardt's method; return the sum of squares.

    What is still above ``hopeless`` after a few steps is no crossing, and is left as it is.
    """
    normal, right = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    held, held_right = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    trial = state.copy()
    cost, damping, moved = math.inf, 1e-2, math.inf
    for step in range(_STEPS):
        new_cost = cost_of(trial, pixels, count, normal, right)
        if new_cost < cost:
            settled = moved < 1e-4 and cost - new_cost < 1e-5 * cost
            for i in range(PARAMETERS):
                state[i], held_right[i] = trial[i], right[i]
                for j in range(i + 1):
                    held[i, j] = normal[i, j]
            cost, damping = new_cost, max(damping * 0.2, 1e-7)
            if settled:
                break
        else:
            damping *= 8.0
        if step == _FEW and cost > hopeless:
            break
        for i in range(PARAMETERS):
            trial[i] = held_right[i]
            for j in range(i + 1):
                normal[i, j] = held[i, j]
            normal[i, i] += damping * held[i, i] + 1e-9
        if not factor_cholesky(normal, PARAMETERS, 1e-14):
            break
        solve_factored(normal, PARAMETERS, trial)
        moved = math.hypot(trial[U], trial[V])
        for i in range(PARAMETERS):
            trial[i] += state[i]
        for i in (BEND_1, BEND_2):
            trial[i] = min(max(trial[i], -_MOST_BEND), _MOST_BEND)
        trial[LOG_BLUR] = min(max(trial[LOG_BLUR], _LEAST_LOG_BLUR), _MOST_LOG_BLUR)
    return cost


@kernel
def purity(state: FloatArray, pixels: FloatArray, count: int) -> float:
    """Least part, over the four quadrants, of pixels that are on their quadrant's side of the middle grey.

    A quadrant outside the image counts as pure, but only one may be missing.
    """
    slope, ready = np.empty(PARAMETERS), np.empty(5)
    prepare(state, ready)
    inside, right = np.zeros(4), np.zeros(4)
    for k in range(count):
        crossing(state, ready, pixels[k, 0], pixels[k, 1], slope)
        if abs(slope[CONTRAST]) < _DECIDED:
            continue
        qx, qy = pixels[k, 0] - state[U], pixels[k, 1] - state[V]
        quadrant = 0
        if ready[0] * qy - ready[1] * qx > 0.0:
            quadrant += 1
        if ready[3] * qx - ready[2] * qy > 0.0:
            quadrant += 2
        inside[quadrant] += 1.0
        if (pixels[k, 2] - state[GREY]) * slope[CONTRAST] * state[CONTRAST] > 0.0:
            right[quadrant] += 1.0
    least, missing = 1.0, 0
    for q in range(4):
        if inside[q] < 2.0:
            missing += 1
        else:
            least = min(least, right[q] / inside[q])
    return least if missing <= 1 else 0.0


@kernel
def drop_foreign(state: FloatArray, pixels: FloatArray, count: int) -> int:
    """Give no weight to pixels that show something else (beyond the lens's rim, a finger); return how many.

    Near the corner all pixels stay: overexposed bright squares grow together there.
    """
    slope, ready = np.empty(PARAMETERS), np.empty(5)
    prepare(state, ready)
    dropped = 0
    for k in range(count):
        off = crossing(state, ready, pixels[k, 0], pixels[k, 1], slope) - pixels[k, 2]
        away = math.hypot(pixels[k, 0] - state[U], pixels[k, 1] - state[V])
        if abs(off) > _FOREIGN * abs(state[CONTRAST]) and away > _NEAR:
            pixels[k, 3] = 0.0
            dropped += 1
    return dropped


@kernel
def fit_crossings(
    image: ByteArray,
    starts: FloatArray,
    axes: FloatArray,
    limits: FloatArray,
    seen: BoolArray,
    states: FloatArray,
    results: FloatArray,
) -> None:
    """Fit every start: ``states`` (n, 11) relative to it; ``results`` (n, 3): explained, purity, pixels."""
    pixels = np.empty((int(2 * math.ceil(limits[2]) + 1) ** 2, 4))
    for n in range(len(starts)):
        count = gather(image, starts[n], axes[n], limits, seen, pixels)
        results[n, 2] = count
        if count < 2 * PARAMETERS:
            continue
        state = states[n]
        state[ANGLE_1] = math.atan2(axes[n, 1, 0], axes[n, 0, 0])
        state[ANGLE_2] = math.atan2(axes[n, 1, 1], axes[n, 0, 1])
        total, mean = 0.0, 0.0
        for k in range(count):
            total += pixels[k, 3]
            mean += pixels[k, 3] * pixels[k, 2]
        mean /= total
        spread, contrast = 0.0, 0.0
        for k in range(count):
            x, y, off = pixels[k, 0], pixels[k, 1], pixels[k, 3] * (pixels[k, 2] - mean)
            spread += off * (pixels[k, 2] - mean)
            side = (axes[n, 1, 1] * x - axes[n, 0, 1] * y) * (axes[n, 0, 0] * y - axes[n, 1, 0] * x)
            contrast += off if side > 0.0 else -off
        state[GREY], state[CONTRAST] = mean, contrast / total
        for again in range(2):
            cost = descend(state, pixels, count, _HOPELESS * spread)
            if again == 0:
                results[n, 0] = 1.0 - cost / max(spread, 1e-9)
                results[n, 1] = purity(state, pixels, count)
                if drop_foreign(state, pixels, count) == 0:
                    break
