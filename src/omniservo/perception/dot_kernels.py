"""The compiled part of dot finding: grey-weighted moments of one dark blob, and how much it looks like a dot.

A dot is dark on a ground that is, around it, a plane of grey: I(x) = g(x) − c·T(x) with T the coverage of a
pixel by an ellipse. The moments are those of the darkness g − I over the pixels up to `GROWTH` outside the
ellipse that has these moments (a fixed point). A pixel averages over its square, which adds 1/12 px² to the
second moments and nothing to the first and third ones; any symmetric blur likewise.
"""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

GROWTH = 1.5
"""how far outside the ellipse darkness is collected [px]: an edge spreads over one pixel, blur adds to it"""
RING = 1.5
"""width of the ring around it that must be bright, and gives the ground [px]"""
STRAY = 0.12
"""a pixel of the ring that is off the ground by more than this part of the contrast is something else"""
PIXEL_VARIANCE = 1.0 / 12.0

U, V, S_UU, S_UV, S_VV, CONTRAST, GROUND = range(7)
"""The first places of what `measure_blobs` says about a blob: centre and second moments [px, px²], contrast
and ground [grey]"""
ROUGHNESS, OFF_GROUND, SKEWNESS, MISFIT, AREA, MEASURED, NOISE = range(7, 14)
"""the others: the ring's rms deviation [grey], the part of it that is not ground, skewness, misfit [of the
contrast], area [px²], 1 where it could be measured, and what a grey value of noise adds to the skewness"""

COLUMNS = NOISE + 1
"""how many these are"""


@leaf
def edge_distance(x: float, y: float, a: float, b: float, c: float) -> float:
    """Signed first-order distance [px] from (x, y) to the ellipse a·x² + 2b·xy + c·y² = 1; inside < 0."""
    gx = a * x + b * y
    gy = b * x + c * y
    square = x * gx + y * gy
    slope = math.hypot(gx, gy)
    if slope < 1e-12:
        return -1e3
    q = math.sqrt(square)
    return (q - 1.0) * q / slope


@leaf
def inverse_of_shape(suu: float, suv: float, svv: float) -> tuple[float, float, float]:
    """(a, b, c) of the ellipse with second moments S: (4S)⁻¹."""
    determinant = 4.0 * (suu * svv - suv * suv)
    return svv / determinant, -suv / determinant, suu / determinant


@leaf
def fit_ground(
    image: ByteArray, box: IntArray, shape: FloatArray, tolerance: float, ground: FloatArray
) -> tuple[int, int, float]:
    """Fit a plane of grey (value at the centre, two slopes) to the ring.

    Pixels farther than ``tolerance`` from the last plane are left out.

    Returns the number of pixels used, of those left out, and the squared deviations of the used ones from
    the last plane.
    """
    u0, v0 = shape[0], shape[1]
    a, b, c = inverse_of_shape(shape[2], shape[3], shape[4])
    n = left = 0
    squares = 0.0
    sx = sy = sxx = sxy = syy = sg = sgx = sgy = 0.0
    for v in range(box[1], box[3] + 1):
        for u in range(box[0], box[2] + 1):
            x, y = u - u0, v - v0
            d = edge_distance(x, y, a, b, c)
            if d <= GROWTH or d > GROWTH + RING:
                continue
            g = float(image[v, u])
            off = g - ground[0] - ground[1] * x - ground[2] * y
            if abs(off) > tolerance:
                left += 1
                continue
            squares += off * off
            n += 1
            sx += x
            sy += y
            sxx += x * x
            sxy += x * y
            syy += y * y
            sg += g
            sgx += g * x
            sgy += g * y
    if n < 8:
        return 0, left, squares
    mx, my, mg = sx / n, sy / n, sg / n
    cxx, cxy, cyy = sxx - n * mx * mx, sxy - n * mx * my, syy - n * my * my
    cgx, cgy = sgx - n * mg * mx, sgy - n * mg * my
    determinant = cxx * cyy - cxy * cxy
    if determinant <= 1e-6 * cxx * cyy:
        return 0, left, squares
    ground[1] = (cgx * cyy - cgy * cxy) / determinant
    ground[2] = (cgy * cxx - cgx * cxy) / determinant
    ground[0] = mg - ground[1] * mx - ground[2] * my
    return n, left, squares


@leaf
def guess_ground(image: ByteArray, box: IntArray, shape: FloatArray, ground: FloatArray) -> float:
    """Set a flat ground: the mean of the ring's brighter half. Returns how much darker it gets inside."""
    a, b, c = inverse_of_shape(shape[2], shape[3], shape[4])
    darkest = 255.0
    level = -1.0
    for _ in range(2):
        total = n = 0.0
        for v in range(box[1], box[3] + 1):
            for u in range(box[0], box[2] + 1):
                d = edge_distance(u - shape[0], v - shape[1], a, b, c)
                g = float(image[v, u])
                if d <= GROWTH:
                    darkest = min(darkest, g)
                elif d <= GROWTH + RING and g >= level:
                    total += g
                    n += 1.0
        level = total / max(n, 1.0)
    ground[0] = level
    ground[1] = 0.0
    ground[2] = 0.0
    return level - darkest


@leaf
def fit_moments(image: ByteArray, box: IntArray, shape: FloatArray, ground: FloatArray) -> float:
    """Replace ``shape`` (u, v, S_uu, S_uv, S_vv) by the darkness's moments; returns its sum, 0: not dark."""
    u0, v0 = shape[0], shape[1]
    a, b, c = inverse_of_shape(shape[2], shape[3], shape[4])
    m = mx = my = mxx = mxy = myy = 0.0
    for v in range(box[1], box[3] + 1):
        for u in range(box[0], box[2] + 1):
            x, y = u - u0, v - v0
            if edge_distance(x, y, a, b, c) > GROWTH:
                continue
            w = ground[0] + ground[1] * x + ground[2] * y - image[v, u]
            m += w
            mx += w * x
            my += w * y
            mxx += w * x * x
            mxy += w * x * y
            myy += w * y * y
    if m <= 0.0:
        return 0.0
    mx /= m
    my /= m
    shape[0] = u0 + mx
    shape[1] = v0 + my
    suu = mxx / m - mx * mx - PIXEL_VARIANCE
    suv = mxy / m - mx * my
    svv = myy / m - my * my - PIXEL_VARIANCE
    # the thinnest ellipse that a pixel can still say something about: half axis 0.5 px
    least = 0.0625
    half_sum = 0.5 * (suu + svv)
    spread = math.hypot(0.5 * (suu - svv), suv)
    lift = max(0.0, least - (half_sum - spread))
    shape[2] = suu + lift
    shape[3] = suv
    shape[4] = svv + lift
    return m


@leaf
def set_box(shape: FloatArray, width: int, height: int, box: IntArray) -> bool:
    """Set the pixels (u_min, v_min, u_max, v_max) of ellipse and ring; False: they leave the image."""
    reach_u = 2.0 * math.sqrt(shape[2]) + GROWTH + RING
    reach_v = 2.0 * math.sqrt(shape[4]) + GROWTH + RING
    box[0] = math.floor(shape[0] - reach_u)
    box[1] = math.floor(shape[1] - reach_v)
    box[2] = math.ceil(shape[0] + reach_u)
    box[3] = math.ceil(shape[1] + reach_v)
    return bool(box[0] >= 0 and box[1] >= 0 and box[2] < width and box[3] < height)


@leaf
def judge(
    image: ByteArray, box: IntArray, shape: FloatArray, ground: FloatArray, darkness: float, row: FloatArray
) -> None:
    """Measure how much the blob looks like a dot; write `CONTRAST` and the like into ``row``."""
    u0, v0 = shape[0], shape[1]
    a, b, c = inverse_of_shape(shape[2], shape[3], shape[4])
    # in the middle the dot covers whole pixels, if it is large enough to
    core = core_n = 0.0
    t0 = t1 = t2 = t3 = sixth = 0.0
    # whitening: lower Cholesky factor of S with the pixel's square
    l00 = math.sqrt(shape[2] + PIXEL_VARIANCE)
    l10 = shape[3] / l00
    l11 = math.sqrt(shape[4] + PIXEL_VARIANCE - l10 * l10)
    for v in range(box[1], box[3] + 1):
        for u in range(box[0], box[2] + 1):
            x, y = u - u0, v - v0
            w = ground[0] + ground[1] * x + ground[2] * y - image[v, u]
            d = edge_distance(x, y, a, b, c)
            if d <= GROWTH:
                p = x / l00
                q = (y - l10 * p) / l11
                t0 += w * p * p * p
                t1 += w * p * p * q
                t2 += w * p * q * q
                t3 += w * q * q * q
                sixth += (p * p + q * q) ** 3
                if d < -1.2:
                    core += w
                    core_n += 1.0
    area = 4.0 * math.pi * math.sqrt(shape[2] * shape[4] - shape[3] * shape[3])
    contrast = darkness / area
    if core_n >= 3.0:
        contrast = max(contrast, core / core_n)
    row[CONTRAST] = contrast
    row[GROUND] = ground[0]
    row[SKEWNESS] = math.sqrt(t0 * t0 + 3.0 * (t1 * t1 + t2 * t2) + t3 * t3) / darkness
    row[AREA] = darkness / contrast
    row[NOISE] = math.sqrt(sixth) / darkness


@leaf
def misfit(
    image: ByteArray, box: IntArray, shape: FloatArray, ground: FloatArray, contrast: float, area: float
) -> tuple[float, float]:
    """Rms of I − (g − c·T) over the dot and its edge, relative to c; and the blur's variance [px²].

    The blur is the one that makes the ellipse's area equal to ``area`` = darkness / contrast; an edge
    blurred by it is drawn as a ramp of the same variance. T is the mean over 4×4 points of the pixel near
    the edge.
    """
    half_sum = 0.5 * (shape[2] + shape[4])
    spread = math.hypot(0.5 * (shape[2] - shape[4]), shape[3])
    wanted = area / (4.0 * math.pi)
    blur = half_sum - math.sqrt(wanted * wanted + spread * spread)
    blur = min(max(blur, 0.0), 0.7 * (half_sum - spread))
    a, b, c = inverse_of_shape(shape[2] - blur, shape[3], shape[4] - blur)
    ramp = math.sqrt(12.0 * blur) + 1e-3
    squares = count = 0.0
    for v in range(box[1], box[3] + 1):
        for u in range(box[0], box[2] + 1):
            x, y = u - shape[0], v - shape[1]
            d = edge_distance(x, y, a, b, c)
            if d > GROWTH:
                continue
            cover = 1.0
            if d > -1.0 - ramp:
                cover = 0.0
                for i in range(4):
                    for k in range(4):
                        d = edge_distance(x + 0.25 * i - 0.375, y + 0.25 * k - 0.375, a, b, c)
                        cover += min(max(0.5 - d / ramp, 0.0), 1.0) / 16.0
            w = ground[0] + ground[1] * x + ground[2] * y - image[v, u]
            squares += (w - contrast * cover) ** 2
            count += 1.0
    return math.sqrt(squares / max(count, 1.0)) / contrast, blur


@kernel
def measure_blobs(image: ByteArray, starts: FloatArray, largest: float, rows: FloatArray) -> None:
    """Measure every blob from its ``starts`` (n, 5), as far as S_VV, into zeroed ``rows`` (n, COLUMNS)."""
    height, width = image.shape
    shape = np.empty(5)
    ground = np.zeros(3)
    box = np.zeros(4, np.int64)
    for i in range(starts.shape[0]):
        row = rows[i]
        for k in range(5):
            shape[k] = starts[i, k]
        tolerance = 0.0
        darkness = 0.0
        good = False
        for step in range(12):
            good = set_box(shape, width, height, box) and 4.0 * max(shape[2], shape[4]) < largest * largest
            if not good:
                break
            if step == 0:
                tolerance = 2.0 * STRAY * guess_ground(image, box, shape, ground)
            n, left, squares = fit_ground(image, box, shape, tolerance, ground)
            row[ROUGHNESS] = math.sqrt(squares / max(n, 1))
            row[OFF_GROUND] = left / max(n + left, 1)
            good = n >= 8 and n > left
            if not good:
                break
            u, v, suu, svv = shape[0], shape[1], shape[2], shape[4]
            darkness = fit_moments(image, box, shape, ground)
            good = darkness > 0.0
            if not good:
                break
            area = 4.0 * math.pi * math.sqrt(shape[2] * shape[4] - shape[3] * shape[3])
            tolerance = STRAY * darkness / area
            moved = abs(shape[0] - u) + abs(shape[1] - v) + abs(shape[2] - suu) + abs(shape[4] - svv)
            if step > 2 and moved < 2e-3:
                break
        if not good or not set_box(shape, width, height, box):
            continue
        for k in range(5):
            row[k] = shape[k]
        judge(image, box, shape, ground, darkness, row)
        row[MISFIT], blur = misfit(image, box, shape, ground, row[CONTRAST], row[AREA])
        row[S_UU] -= blur
        row[S_VV] -= blur
        row[MEASURED] = 1.0
