"""The compiled part of tag fitting: a tag's grey values from its code, and the step towards an image's.

A tag's plane has coordinates x, y ∈ [−1, 1] inside its black square; a bearing b sees the place with
(x, y, 1) ∝ G b, whatever the camera. The blur is isotropic in the image, with standard deviation σ px that
takes in the pixel's own square. At a place it becomes a Gaussian on the tag with deviations σx, σy and
correlation ρ, and of a cell [x₀, x₁] × [y₀, y₁] the pixel collects, to first order in ρ (exact along edges,
where only one coordinate counts),

    ΔΦx ΔΦy + ρ Δφx Δφy,   ΔΦx = Φ((x₁−x)/σx) − Φ((x₀−x)/σx),   Δφx likewise with the density φ.

With D the sum over the dark cells, the grey value is W − C·D; W and C are linear in x and y.
"""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import inlined, kernel

D11, D12, D13, D21, D22, D23, D31, D32, LOG_SIGMA, W, W_X, W_Y, C, C_X, C_Y = range(15)
"""the places of the parameters: of G, G ← (1 + δ) G with δ₃₃ = 0; log σ; W and C: value, slopes by x and y"""
POSE = D32 + 1
"""parameters of G"""
PARAMETERS = C_Y + 1
"""all"""
_REACH = 4.0
"""standard deviations beyond which an edge is not felt"""
_SQRT_HALF = math.sqrt(0.5)
_DENSITY = 1.0 / math.sqrt(2.0 * math.pi)
_HUBER = 2.0
"""residuals beyond so many rms count less: something in front of the tag"""


@inlined
def _along(place: float, deviation: float, cells: int, out: FloatArray) -> tuple[int, int]:
    """Share of the blur in each cell of one axis: differences of Φ, φ, zφ, z²φ, the rows of ``out``.

    Place and deviation in cells. Returns the first cell reached and the one after the last.
    """
    first = max(0, math.floor(place - _REACH * deviation))
    last = min(cells, math.floor(place + _REACH * deviation) + 1)
    if first >= last:
        return 0, 0
    z = (first - place) / deviation
    low = 0.5 * math.erf(z * _SQRT_HALF)
    low_density = _DENSITY * math.exp(-0.5 * z * z)
    low_moment = z * low_density
    low_square = z * low_moment
    for k in range(first, last):
        z = (k + 1 - place) / deviation
        high = 0.5 * math.erf(z * _SQRT_HALF)
        density = _DENSITY * math.exp(-0.5 * z * z)
        moment = z * density
        out[0, k] = high - low
        out[1, k] = density - low_density
        out[2, k] = moment - low_moment
        out[3, k] = z * moment - low_square
        low, low_density, low_moment, low_square = high, density, moment, z * moment
    return first, last


@inlined
def _place(G: FloatArray, ray: FloatArray, along_u: FloatArray, along_v: FloatArray, out: FloatArray) -> bool:
    """Set ``out`` to x, y and the blur of one pixel there: σx, σy, ρ. False: the ray does not meet it."""
    q0 = G[0, 0] * ray[0] + G[0, 1] * ray[1] + G[0, 2] * ray[2]
    q1 = G[1, 0] * ray[0] + G[1, 1] * ray[1] + G[1, 2] * ray[2]
    q2 = G[2, 0] * ray[0] + G[2, 1] * ray[1] + G[2, 2] * ray[2]
    if q2 <= 1e-12:
        return False
    x, y = q0 / q2, q1 / q2
    a = G[2, 0] * along_u[0] + G[2, 1] * along_u[1] + G[2, 2] * along_u[2]
    xu = (G[0, 0] * along_u[0] + G[0, 1] * along_u[1] + G[0, 2] * along_u[2] - x * a) / q2
    yu = (G[1, 0] * along_u[0] + G[1, 1] * along_u[1] + G[1, 2] * along_u[2] - y * a) / q2
    a = G[2, 0] * along_v[0] + G[2, 1] * along_v[1] + G[2, 2] * along_v[2]
    xv = (G[0, 0] * along_v[0] + G[0, 1] * along_v[1] + G[0, 2] * along_v[2] - x * a) / q2
    yv = (G[1, 0] * along_v[0] + G[1, 1] * along_v[1] + G[1, 2] * along_v[2] - y * a) / q2
    sx, sy = math.hypot(xu, xv), math.hypot(yu, yv)
    if not (sx > 1e-12 and sy > 1e-12):
        return False
    out[0], out[1], out[2], out[3] = x, y, sx, sy
    out[4] = (xu * yu + xv * yv) / (sx * sy)
    return True


@inlined
def _shade(
    dark: BoolArray,
    place: FloatArray,
    sx: float,
    sy: float,
    x_shares: FloatArray,
    y_shares: FloatArray,
    out: FloatArray,
) -> None:
    """Set ``out`` to D at a place, and its derivatives by x and y [cells/deviation], log σx, log σy and ρ.

    Args:
        dark: (cells, cells) of the tag.
        place: as `_place` has it.
        sx: σx in cells.
        sy: σy in cells.
        x_shares: (4, cells) written.
        y_shares: (4, cells) written.
        out: (6,) written.
    """
    cells = len(dark)
    half = 0.5 * cells
    rho = place[4]
    j0, j1 = _along((place[0] + 1.0) * half, sx, cells, x_shares)
    i0, i1 = _along((place[1] + 1.0) * half, sy, cells, y_shares)
    d = dx = dy = blur_x = blur_y = corners = 0.0
    for i in range(i0, i1):
        for j in range(j0, j1):
            if dark[i, j]:
                d += x_shares[0, j] * y_shares[0, i] + rho * x_shares[1, j] * y_shares[1, i]
                dx -= x_shares[1, j] * y_shares[0, i] - rho * x_shares[2, j] * y_shares[1, i]
                dy -= x_shares[0, j] * y_shares[1, i] - rho * x_shares[1, j] * y_shares[2, i]
                blur_x -= x_shares[2, j] * y_shares[0, i] - rho * x_shares[3, j] * y_shares[1, i]
                blur_y -= x_shares[0, j] * y_shares[2, i] - rho * x_shares[1, j] * y_shares[3, i]
                corners += x_shares[1, j] * y_shares[1, i]
    out[0], out[1], out[2], out[3], out[4], out[5] = d, dx, dy, blur_x, blur_y, corners


@inlined
def _derivatives(
    others: FloatArray,
    place: FloatArray,
    contrast: float,
    half: float,
    sx: float,
    sy: float,
    d: FloatArray,
    row: FloatArray,
) -> None:
    """Set ``row`` to the derivatives of a grey value by all parameters; ``d`` as `_shade` has it."""
    x, y = place[0], place[1]
    gx = others[2] - others[5] * d[0] - contrast * d[1] * half / sx
    gy = others[3] - others[6] * d[0] - contrast * d[2] * half / sy
    # with the pose the tag grows and shears, and with it σx, σy and ρ
    bx, by = -contrast * d[3], -contrast * d[4]
    turned = -contrast * d[5] * (1.0 - place[4] ** 2)
    shear_x, shear_y = (bx * place[4] + turned) * sy / sx, (by * place[4] + turned) * sx / sy
    turn = gx * x + gy * y
    row[D11], row[D12], row[D13] = gx * x + bx, gx * y + shear_x, gx
    row[D21], row[D22], row[D23] = gy * x + shear_y, gy * y + by, gy
    row[D31] = -turn * x - 2.0 * bx * x - by * x - shear_y * y
    row[D32] = -turn * y - bx * y - shear_x * x - 2.0 * by * y
    row[LOG_SIGMA] = bx + by
    row[W], row[W_X], row[W_Y] = 1.0, x, y
    row[C], row[C_X], row[C_Y] = -d[0], -d[0] * x, -d[0] * y


@kernel
def normal_equations(
    greys: FloatArray,
    rays: FloatArray,
    dark: BoolArray,
    window: FloatArray,
    state: tuple[FloatArray, FloatArray],
    rms: float,
    matrix: FloatArray,
    vector: FloatArray,
) -> tuple[int, float]:
    """Set the normal equations of one step; return the number of pixels and their mean squared residual.

    Args:
        greys: (n,) of the pixels.
        rays: (n, 3, 3) rows bearing, ∂bearing/∂u, ∂bearing/∂v.
        dark: (cells, cells) of the tag.
        window: (inner, outer): pixels with inner ≤ max(|x|, |y|) ≤ outer count.
        state: G (3, 3); the other parameters (7,): log σ, W, C.
        rms: scale of the residuals, for their weights.
        matrix: (PARAMETERS, PARAMETERS) receives JᵀWJ.
        vector: (PARAMETERS,) receives JᵀWr.
    """
    G, others = state
    cells = len(dark)
    half = 0.5 * cells
    sigma = math.exp(others[0])
    x_shares, y_shares = np.empty((4, cells)), np.empty((4, cells))
    row, place, d = np.empty(PARAMETERS), np.empty(5), np.empty(6)
    matrix[:] = 0.0
    vector[:] = 0.0
    count, total = 0, 0.0
    for n in range(len(greys)):
        if not _place(G, rays[n, 0], rays[n, 1], rays[n, 2], place):
            continue
        x, y = place[0], place[1]
        out = max(abs(x), abs(y))
        if out < window[0] or out > window[1]:
            continue
        sx, sy = place[2] * sigma * half, place[3] * sigma * half
        _shade(dark, place, sx, sy, x_shares, y_shares, d)
        contrast = others[4] + others[5] * x + others[6] * y
        residual = greys[n] - (others[1] + others[2] * x + others[3] * y - contrast * d[0])
        _derivatives(others, place, contrast, half, sx, sy, d, row)
        size = abs(residual)
        weight = 1.0 if size <= _HUBER * rms else _HUBER * rms / size
        for a in range(PARAMETERS):
            w = weight * row[a]
            vector[a] += w * residual
            for b in range(a + 1):
                matrix[a, b] += w * row[b]
        count += 1
        total += weight * residual * residual
    for a in range(PARAMETERS):
        for b in range(a):
            matrix[b, a] = matrix[a, b]
    return count, total / max(count, 1)


@kernel
def cell_darkness(
    greys: FloatArray,
    rays: FloatArray,
    dark: BoolArray,
    outer: float,
    state: tuple[FloatArray, FloatArray],
    darkness: FloatArray,
    information: FloatArray,
) -> float:
    """Measure how dark each cell is, given all others as the code has them.

    ``darkness`` (cells, cells) receives 0 bright … 1 dark: the least-squares estimate from the pixels that
    the cell's share reaches; ``information`` the sum of squared shares, whose inverse is the estimate's
    variance in those of a pixel's darkness. Returns the part of the grey values' variance that the tag
    explains.
    """
    G, others = state
    cells = len(dark)
    half = 0.5 * cells
    sigma = math.exp(others[0])
    x_shares, y_shares, place = np.empty((4, cells)), np.empty((4, cells)), np.empty(5)
    darkness[:] = 0.0
    information[:] = 0.0
    n_used = 0
    total = squares = unexplained = 0.0
    for n in range(len(greys)):
        if not _place(G, rays[n, 0], rays[n, 1], rays[n, 2], place):
            continue
        x, y = place[0], place[1]
        if max(abs(x), abs(y)) > outer:
            continue
        j0, j1 = _along((x + 1.0) * half, place[2] * sigma * half, cells, x_shares)
        i0, i1 = _along((y + 1.0) * half, place[3] * sigma * half, cells, y_shares)
        d = 0.0
        for i in range(i0, i1):
            for j in range(j0, j1):
                if dark[i, j]:
                    d += x_shares[0, j] * y_shares[0, i] + place[4] * x_shares[1, j] * y_shares[1, i]
        white = others[1] + others[2] * x + others[3] * y
        contrast = max(others[4] + others[5] * x + others[6] * y, 1.0)
        seen = (white - greys[n]) / contrast
        for i in range(i0, i1):
            for j in range(j0, j1):
                share = x_shares[0, j] * y_shares[0, i]
                darkness[i, j] += share * (seen - d)
                information[i, j] += share * share
        n_used += 1
        total += seen
        squares += seen * seen
        unexplained += (seen - d) ** 2
    for i in range(cells):
        for j in range(cells):
            darkness[i, j] = darkness[i, j] / max(information[i, j], 1e-9) + (1.0 if dark[i, j] else 0.0)
    spread = squares - total * total / max(n_used, 1)
    return 1.0 - unexplained / max(spread, 1e-9)
