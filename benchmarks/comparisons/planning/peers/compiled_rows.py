"""The constraints of `samples`, with exact slopes, compiled: for solvers that call back into Python.

Rows and values are those of `samples.families`; only the rows that are awake are looked at.
"""

from __future__ import annotations

import math

import numpy as np
from benchmarks.comparisons.planning.neutral import SMALLEST_UNIT, Neutral
from benchmarks.comparisons.planning.path_space import PathSpace, bernstein_basis
from benchmarks.comparisons.planning.samples import ROTATION_FLOOR

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel


class CompiledRows:
    """The constraints of a `PathSpace` at samples w (s,)."""

    def __init__(self, space: PathSpace, w: FloatArray) -> None:
        self._space = space
        self._rotation = np.ascontiguousarray(bernstein_basis(space.sigma, w))
        self._translation = np.ascontiguousarray(bernstein_basis(space.tau, w))
        self.shape = len(w), row_count(space.neutral)
        self._slopes, self._values = np.zeros((*self.shape, 7)), np.zeros(self.shape)
        self._all = np.ones(self.shape, dtype=np.bool_)

    def values(self, x: FloatArray) -> FloatArray:
        """Return g (s, m)."""
        self._look(x, self._all, False)
        return self._values.copy()

    def linearised(self, x: FloatArray, awake: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return g (a,) and ∂g/∂x (a, nx) of the rows that are ``awake`` (s, m)."""
        self._look(x, awake, True)
        jacobian = np.empty((int(np.count_nonzero(awake)), x.size))
        spread(self._slopes, awake, self._rotation, self._space.neutral.ell, self._translation, jacobian)
        return self._values[awake], jacobian

    def _look(self, x: FloatArray, awake: BoolArray, slopes: bool) -> None:
        phi, t = self._space.controls(x)
        poses = self._rotation @ phi.T, self._translation @ t.T
        look(self._space.neutral, *poses, awake, slopes, self._values, self._slopes)


def row_count(neutral: Neutral) -> int:
    """Return m, the rows of one sample."""
    points, spheres = len(neutral.points), neutral.spheres
    sights = points * int(np.count_nonzero(spheres[:, 3] > 0.0)) if neutral.occlusion else 0
    image = points * (len(neutral.limits) + (neutral.disc.size > 0) + 1)
    return int(image + np.count_nonzero(spheres[:, 4] > 0.0) + len(neutral.boxes) + sights + 1)


@kernel
def look(
    neutral: Neutral,
    phi: FloatArray,
    t: FloatArray,
    awake: BoolArray,
    wanted: bool,
    g: FloatArray,
    slopes: FloatArray,
) -> None:
    """Write g (s, m) of the awake rows at poses (s, 4), (s, 3), and where ``wanted`` ∂g/∂(φ, t) (s, m, 7)."""
    n, k = neutral.points.shape[0], neutral.limits.shape[0]
    frame, away, c = np.empty((3, 7)), np.empty((n, 4)), np.empty((n, 3))
    for s in range(phi.shape[0]):
        set_frame(phi[s], frame)
        for j in range(n):
            for a in range(3):
                away[j, a] = neutral.points[j, a] - t[s, a]
            square = away[j, 0] ** 2 + away[j, 1] ** 2 + away[j, 2] ** 2
            away[j, 3] = max(math.sqrt(square), 1e-12)
            for a in range(3):
                c[j, a] = (
                    frame[0, 4 + a] * away[j, 0] + frame[1, 4 + a] * away[j, 1] + frame[2, 4 + a] * away[j, 2]
                )
        row = 0
        for j in range(n):
            for i in range(k):
                if awake[s, row]:
                    g[s, row] = limit_row(neutral.limits[i], c[j], away[j, 3], frame, wanted, slopes[s, row])
                row += 1
        if neutral.disc.shape[0] > 0:
            for j in range(n):
                if awake[s, row]:
                    g[s, row] = disc_row(neutral.disc, c[j], away[j, 3], frame, wanted, slopes[s, row])
                row += 1
        for j in range(n):
            g[s, row] = (away[j, 3] - neutral.least_distance) / neutral.ell
            f = -1.0 / (away[j, 3] * neutral.ell)
            centre_slope(slopes[s, row], f * away[j, 0], f * away[j, 1], f * away[j, 2])
            row += 1
        row = solid_rows(neutral, t[s], row, g[s], slopes[s])
        if neutral.occlusion:
            row = sight_rows(neutral, t[s], away, row, awake[s], g[s], slopes[s])
        g[s, row] = -ROTATION_FLOOR
        for a in range(4):
            g[s, row] += phi[s, a] ** 2
            slopes[s, row, a] = 2.0 * phi[s, a]
        for a in range(3):
            slopes[s, row, 4 + a] = 0.0


@kernel
def set_frame(phi: FloatArray, frame: FloatArray) -> None:
    """Write ω = 2 vec(φ* ⊗ dφ)/‖φ‖² as rows of ∂ω/∂φ (3, 4), and R beside it (3, 3)."""
    x, y, z, w = phi[0], phi[1], phi[2], phi[3]
    f = 2.0 / max(x * x + y * y + z * z + w * w, 1e-12)
    frame[0, 0], frame[0, 1], frame[0, 2], frame[0, 3] = f * w, f * z, -f * y, -f * x
    frame[1, 0], frame[1, 1], frame[1, 2], frame[1, 3] = -f * z, f * w, f * x, -f * y
    frame[2, 0], frame[2, 1], frame[2, 2], frame[2, 3] = f * y, -f * x, f * w, -f * z
    frame[0, 4], frame[0, 5], frame[0, 6] = (
        1.0 - f * (y * y + z * z),
        f * (x * y - z * w),
        f * (x * z + y * w),
    )
    frame[1, 4], frame[1, 5], frame[1, 6] = (
        f * (x * y + z * w),
        1.0 - f * (x * x + z * z),
        f * (y * z - x * w),
    )
    frame[2, 4], frame[2, 5], frame[2, 6] = (
        f * (x * z - y * w),
        f * (y * z + x * w),
        1.0 - f * (x * x + y * y),
    )


@kernel
def camera_slope(
    slope: FloatArray, frame: FloatArray, c: FloatArray, gx: float, gy: float, gz: float
) -> None:
    """Write ∂g/∂(φ, t) (7,) from ∂g/∂c = (gx, gy, gz): dc = −Rᵀdt − ω × c."""
    ax, ay, az = c[2] * gy - c[1] * gz, c[0] * gz - c[2] * gx, c[1] * gx - c[0] * gy
    for a in range(4):
        slope[a] = ax * frame[0, a] + ay * frame[1, a] + az * frame[2, a]
    for a in range(3):
        slope[4 + a] = -(frame[a, 4] * gx + frame[a, 5] * gy + frame[a, 6] * gz)


@kernel
def centre_slope(slope: FloatArray, x: float, y: float, z: float) -> None:
    """Write ∂g/∂(φ, t) (7,) of a row that depends on t alone."""
    slope[0], slope[1], slope[2], slope[3] = 0.0, 0.0, 0.0, 0.0
    slope[4], slope[5], slope[6] = x, y, z


@kernel
def limit_row(
    limit: FloatArray, c: FloatArray, distance: float, frame: FloatArray, wanted: bool, slope: FloatArray
) -> float:
    """Return κ − n·c/‖c‖."""
    f = 1.0 / distance
    along = (limit[0] * c[0] + limit[1] * c[1] + limit[2] * c[2]) * f
    if wanted:
        e = along * f
        gx, gy, gz = f * (e * c[0] - limit[0]), f * (e * c[1] - limit[1]), f * (e * c[2] - limit[2])
        camera_slope(slope, frame, c, gx, gy, gz)
    return float(limit[3] - along)


@kernel
def disc_row(
    disc: FloatArray, c: FloatArray, distance: float, frame: FloatArray, wanted: bool, slope: FloatArray
) -> float:
    """Return (‖(U, V)‖ − r D)/(|fx| ‖c‖)."""
    d, f = c[2] + disc[6] * distance, 1.0 / distance
    u, v = disc[0] * c[0] + disc[1] * c[1] + disc[3] * d, disc[2] * c[1] + disc[4] * d
    length, scale = math.sqrt(u * u + v * v), 1.0 / abs(disc[0])
    g = scale * f * (length - disc[5] * d)
    if wanted:
        eu, ev = u / max(length, 1e-12), v / max(length, 1e-12)
        third = eu * disc[3] + ev * disc[4] - disc[5]
        e = (scale * third * disc[6] - g) * f
        gx = f * (scale * eu * disc[0] + e * c[0])
        gy = f * (scale * (eu * disc[1] + ev * disc[2]) + e * c[1])
        gz = f * (scale * third + e * c[2])
        camera_slope(slope, frame, c, gx, gy, gz)
    return float(g)


@kernel
def solid_rows(neutral: Neutral, t: FloatArray, row: int, g: FloatArray, slopes: FloatArray) -> int:
    """Write the clearances of spheres and boxes; return the next row."""
    for i in range(neutral.spheres.shape[0]):
        reach = neutral.spheres[i, 4]
        if reach <= 0.0:
            continue
        x, y, z = t[0] - neutral.spheres[i, 0], t[1] - neutral.spheres[i, 1], t[2] - neutral.spheres[i, 2]
        distance, unit = math.sqrt(x * x + y * y + z * z), max(reach, SMALLEST_UNIT * neutral.ell)
        f = 1.0 / (max(distance, 1e-12) * unit)
        g[row] = (distance - reach) / unit
        centre_slope(slopes[row], f * x, f * y, f * z)
        row += 1
    for i in range(neutral.boxes.shape[0]):
        g[row] = box_row(neutral.boxes[i], t, neutral.ell, slopes[row])
        row += 1
    return row


@kernel
def box_row(box: FloatArray, t: FloatArray, ell: float, slope: FloatArray) -> float:
    """Return (signed distance − clearance)/unit; inside, minus the depth below the nearest face."""
    x, y, z = t[0] - box[0], t[1] - box[1], t[2] - box[2]
    unit = max(box[15], SMALLEST_UNIT * ell)
    square, deepest, face, face_sign = 0.0, -math.inf, 0, 1.0
    nx, ny, nz = 0.0, 0.0, 0.0
    for k in range(3):
        i = 3 + 3 * k
        local = box[i] * x + box[i + 1] * y + box[i + 2] * z
        sign, beyond = (1.0 if local >= 0.0 else -1.0), abs(local) - box[12 + k]
        if beyond > deepest:
            deepest, face, face_sign = beyond, i, sign
        if beyond > 0.0:
            square += beyond * beyond
            f = sign * beyond
            nx, ny, nz = nx + f * box[i], ny + f * box[i + 1], nz + f * box[i + 2]
    if square > 0.0:
        gap = math.sqrt(square)
        f = 1.0 / (gap * unit)
        centre_slope(slope, f * nx, f * ny, f * nz)
        return float((gap - box[15]) / unit)
    f = face_sign / unit
    centre_slope(slope, f * box[face], f * box[face + 1], f * box[face + 2])
    return float((deepest - box[15]) / unit)


@kernel
def sight_rows(
    neutral: Neutral,
    t: FloatArray,
    away: FloatArray,
    row: int,
    awake: BoolArray,
    g: FloatArray,
    slopes: FloatArray,
) -> int:
    """Write the gaps of the lines of sight past the spheres; return the next row."""
    for i in range(neutral.spheres.shape[0]):
        radius = neutral.spheres[i, 3]
        if radius <= 0.0:
            continue
        unit = max(radius, SMALLEST_UNIT * neutral.ell)
        px, py, pz = t[0] - neutral.spheres[i, 0], t[1] - neutral.spheres[i, 1], t[2] - neutral.spheres[i, 2]
        for j in range(away.shape[0]):
            if awake[row]:
                a, b, c = away[j, 0], away[j, 1], away[j, 2]
                part = min(max(-(px * a + py * b + pz * c) / away[j, 3] ** 2, 0.0), 1.0)
                x, y, z = px + part * a, py + part * b, pz + part * c
                gap = math.sqrt(x * x + y * y + z * z)
                f = (1.0 - part) / (max(gap, 1e-12) * unit)
                g[row] = (gap - radius) / unit
                centre_slope(slopes[row], f * x, f * y, f * z)
            row += 1
    return row


@kernel
def spread(
    slopes: FloatArray,
    awake: BoolArray,
    rotation: FloatArray,
    ell: float,
    translation: FloatArray,
    jacobian: FloatArray,
) -> None:
    """Write ∂g/∂x (a, nx) of the awake rows from ∂g/∂(φ, t) (s, m, 7) and the bases at the samples."""
    sigma, tau, at = rotation.shape[1] - 1, translation.shape[1] - 1, 0
    for s in range(slopes.shape[0]):
        for row in range(slopes.shape[1]):
            if not awake[s, row]:
                continue
            column = 0
            for k in range(1, sigma):
                for a in range(4):
                    jacobian[at, column] = rotation[s, k] * slopes[s, row, a]
                    column += 1
            for k in range(1, tau):
                for a in range(3):
                    jacobian[at, column] = ell * translation[s, k] * slopes[s, row, 4 + a]
                    column += 1
            at += 1
