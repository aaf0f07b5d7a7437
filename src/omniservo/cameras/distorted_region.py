"""What a distorted camera shows, enclosed from inside by a convex polygon on the undistorted plane m.

The image of the plane is p = K D(m), D radial-tangential distortion. The true region T is the set of m
in a disc ‖m‖ ≤ R for which p lies in the image rectangle (both with the margin). `convex_polygon` returns
a convex P ⊂ T. Why that holds:

1. R is at most the radius up to which D's Jacobian is positive definite, so D is one-to-one on the disc.
2. P's corners lie in the disc, hence P does.
3. Along each edge of P, u and v are polynomials of degree 5 in the edge's parameter; their Bernstein
   coefficients on every piece of the edge stay inside the rectangle, hence the edge's image does.
4. D is continuous and one-to-one, so P's image is what the closed curve of 3 surrounds; a rectangle
   that holds the curve holds that too.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.distorted_mask import distort
from omniservo.cameras.distortion import least_stretch
from omniservo.cameras.model_domain import radius_of_angle
from omniservo.cameras.unified_kernels import SQUARE, undistort
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray

if TYPE_CHECKING:
    from omniservo.cameras.unified_camera import UnifiedCamera

_DIRECTIONS = 128
_PIECES = 16
_TOLERANCE_PX = 1e-7
"""far above the rounding of the Bernstein coefficients, about 1e-11 px"""
_KEPT_AREA = 0.988
"""of the polygon that is found, after corners that hardly matter are dropped"""
_ROUNDS = 8


def convex_polygon(camera: UnifiedCamera, margin_px: float) -> FloatArray:
    """Return the corners (k, 2) of a convex polygon P ⊂ T on the plane m, counter-clockwise.

    P is a local maximum of area among the convex subsets of T that hold the middle, up to 2%: with
    g = 1/(distance from the middle) at fixed directions, convexity and P ⊂ T are linear in g and the
    area is convex in g, so that a sequence of linear programs increases it. Then corners whose loss costs
    less than 1.2% of the area together are dropped, and P is shrunk until the proof above succeeds.

    Raises:
        InputError: no part of the image, moved inward by the margin, is usable.
    """
    radius = _disc(camera, margin_px)
    low = np.array([-0.5 + margin_px, -0.5 + margin_px])
    high = np.array([camera.width, camera.height]) - 0.5 - margin_px
    middle = _middle(camera, low, high, radius)
    angles = _directions(camera, low, high, middle)
    reach = _first_exit(camera, low, high, middle, angles, radius)
    distances = 1.0 / _largest_convex(angles, 1.0 / reach)
    rays = np.column_stack([np.cos(angles), np.sin(angles)])
    shape = _simplified(distances[:, None] * rays)
    for shrink in (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1):
        polygon = middle + (1.0 - shrink) * shape
        if np.hypot(*polygon.T).max() < radius and _edges_inside(camera, polygon, low, high):
            return np.ascontiguousarray(polygon)
    raise InputError(f"margin_px: {margin_px:g} given; no convex part of the distorted image could be proven")


def smallest_scale(camera: UnifiedCamera) -> float:
    """Return the smaller singular value of K's 2×2 block [px]: how many pixels 1 on the plane is at least."""
    total = camera.fx**2 + camera.skew**2 + camera.fy**2
    product = abs(camera.fx * camera.fy)
    largest = math.sqrt(0.5 * (total + math.sqrt(max(0.0, total * total - 4.0 * product * product))))
    return product / largest


def dead_zone_on_plane(camera: UnifiedCamera, zone: DeadZone, margin_px: float) -> DeadZone:
    """Return a disc in the undistorted image K m that holds everything the grown dead zone covers.

    With m₀ seen at the zone's centre and λ ≤ J's eigenvalues within R_b of m₀: the zone's preimage lies
    within r/(σ_min λ) of m₀ as long as that is at most R_b, and its image K m within r σ_max/(σ_min λ).

    Raises:
        InputError: the zone reaches to where the distortion folds or the lens ends: no such disc is known.
    """
    x, y, ok = _plane_point(camera, np.asarray(zone.center))
    smallest = smallest_scale(camera)
    largest = abs(camera.fx * camera.fy) / smallest
    radius = (zone.radius + margin_px) / smallest
    bound, stretch = radius, 0.0
    for _ in range(20):
        stretch = min(1.0, least_stretch(camera.distortion, math.hypot(x, y) + bound)) if ok else 0.0
        if stretch > 0.0 and radius <= stretch * bound:
            center = camera.matrix[:2] @ np.array([x, y, 1.0])
            return DeadZone((float(center[0]), float(center[1])), radius * largest / stretch * (1.0 + 1e-12))
        bound *= 1.1
    raise InputError(f"dead_zone: {zone} given; it reaches beyond the usable part of the distorted image")


def _disc(camera: UnifiedCamera, margin_px: float) -> float:
    """Return R: the usable disc and, where the lens ends inside it, the lens's circle with the margin.

    Where ‖m‖ ≤ r, the pixel is at least σ_min ∫ λ dr inside the circle's image, the integral from r to the
    circle, λ(r) ≤ J's eigenvalues at radius r. A margin with 0.2% to spare is required, more than
    the integral's steps.
    """
    usable = math.sqrt(float(camera.parameters[SQUARE])) * (1.0 - 1e-9)
    if camera.max_angle is None:
        return usable
    lens = radius_of_angle(camera.xi, camera.max_angle)
    if margin_px == 0.0 or math.isinf(lens):
        return min(usable, lens)
    r = np.linspace(lens, 0.0, 1025)
    k1, k2, p1, p2 = camera.distortion
    radial = np.minimum(1.0 + 3.0 * k1 * r**2 + 5.0 * k2 * r**4, 1.0 + k1 * r**2 + k2 * r**4)
    tangential = 6.0 * math.hypot(p1, p2) * r
    if radial[0] + tangential[0] <= 0.0:
        return usable  # folded at the circle: the image ends before it
    stretch = radial - tangential
    lower = np.maximum(0.0, np.minimum(stretch[1:], stretch[:-1]))
    inside = smallest_scale(camera) * np.cumsum(lower) * (lens / 1024.0)
    needed = margin_px * 1.002
    if inside[-1] <= needed:
        raise InputError(f"margin_px: {margin_px:g} given; it leaves nothing inside the max_angle circle")
    return min(usable, float(r[1:][np.searchsorted(inside, needed)]))


def _plane_point(camera: UnifiedCamera, pixel: FloatArray) -> tuple[float, float, bool]:
    py = (float(pixel[1]) - camera.cy) / camera.fy
    px = (float(pixel[0]) - camera.cx - camera.skew * py) / camera.fx
    return undistort(camera.parameters, px, py)


def _middle(camera: UnifiedCamera, low: FloatArray, high: FloatArray, radius: float) -> FloatArray:
    """Return a point well inside T: below the rectangle's centre, or the axis."""
    x, y, ok = _plane_point(camera, (low + high) / 2.0)
    if ok and math.hypot(x, y) < 0.5 * radius:
        return np.array([x, y])
    center = np.array([camera.cx, camera.cy])
    if (center > low).all() and (center < high).all():
        return np.zeros(2)
    raise InputError(
        "image limits: neither the image's centre nor the principal point is a usable part of the image"
    )


def _directions(camera: UnifiedCamera, low: FloatArray, high: FloatArray, middle: FloatArray) -> FloatArray:
    """Return evenly spread angles and those of the rectangle's corners, sorted."""
    angles = list(np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS) + 0.01)
    for corner in ((low[0], low[1]), (high[0], low[1]), (low[0], high[1]), (high[0], high[1])):
        x, y, ok = _plane_point(camera, np.array(corner))
        if ok:
            angles.append(math.atan2(y - middle[1], x - middle[0]) % (2.0 * math.pi))
    ordered = np.unique(np.array(angles))
    return ordered[np.diff(ordered, append=ordered[0] + 2.0 * math.pi) > 1e-4]


def _first_exit(
    camera: UnifiedCamera,
    low: FloatArray,
    high: FloatArray,
    middle: FloatArray,
    angles: FloatArray,
    radius: float,
) -> FloatArray:
    """Return, for each direction, how far from the middle T goes on without a break."""
    rays = np.column_stack([np.cos(angles), np.sin(angles)])

    def inside(distances: FloatArray) -> BoolArray:
        m = middle + distances[..., None] * rays
        p = distort(camera, m)
        seen: BoolArray = ((p >= low) & (p <= high)).all(axis=-1) & (np.hypot(m[..., 0], m[..., 1]) <= radius)
        return seen

    furthest = 1.0
    while inside(np.full(len(angles), furthest)).any():
        furthest *= 2.0
    steps = np.linspace(0.0, furthest, 257)[:, None]
    first_outside = np.argmax(~inside(np.broadcast_to(steps, (257, len(angles)))), axis=0)
    lower, upper = steps[np.maximum(first_outside - 1, 0), 0], steps[first_outside, 0]
    for _ in range(40):
        half = 0.5 * (lower + upper)
        good = inside(half)
        lower, upper = np.where(good, half, lower), np.where(good, upper, half)
    if (lower <= 0.0).any():
        raise InputError("image limits: the margin leaves nothing of the image round its middle")
    return np.asarray(lower)


def _largest_convex(angles: FloatArray, least: FloatArray) -> FloatArray:
    """Return g ≥ least that bounds a convex polygon of locally largest area, corners at 1/g."""
    n = len(angles)
    gap = np.diff(angles, append=angles[0] + 2.0 * math.pi)
    before, after = np.sin(np.roll(gap, 1)), np.sin(gap)
    both = np.sin(np.roll(gap, 1) + gap)
    # convex at corner i: g[i] sin(α+β) ≤ g[i−1] sin β + g[i+1] sin α
    i = np.arange(n)
    conditions = np.zeros((n, n))
    conditions[i, i], conditions[i, i - 1], conditions[i, (i + 1) % n] = both, -after, -before
    g = least
    if (conditions @ g <= 0.0).all():
        return g
    from scipy.optimize import linprog  # slow to import, and few images are distorted so far

    bounds = [(float(x), 50.0 * float(x)) for x in least]
    area = 0.0
    for _ in range(_ROUNDS):
        pairs = after / (g * np.roll(g, -1))
        slope = (pairs + np.roll(pairs, 1)) / g
        result = linprog(slope, A_ub=conditions, b_ub=np.zeros(n), bounds=bounds)
        if not result.success:
            raise InputError(f"image limits: no convex part of the distorted image found ({result.message})")
        g = np.maximum(np.asarray(result.x), least)
        new_area = 0.5 * float(np.sum(after / (g * np.roll(g, -1))))
        if new_area <= area * (1.0 + 1e-4):
            break
        area = new_area
    return g


def _simplified(corners: FloatArray) -> FloatArray:
    """Return the polygon without the corners that together cost less than 1.2% of the area."""
    polygon = corners
    floor = _KEPT_AREA * _area(corners)
    while len(polygon) > 3:
        triangles = _cross(polygon - np.roll(polygon, 1, 0), np.roll(polygon, -1, 0) - polygon)
        rest = np.delete(polygon, int(np.argmin(triangles)), axis=0)
        if _area(rest) < floor:
            break
        polygon = rest
    return polygon


def _area(polygon: FloatArray) -> float:
    return 0.5 * float(np.sum(_cross(polygon, np.roll(polygon, -1, axis=0))))


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _bernstein_from_samples() -> FloatArray:
    """Return the matrix that takes a quintic's values at t = 0, 1/5, …, 1 to its Bernstein coefficients."""
    t = np.linspace(0.0, 1.0, 6)[:, None]
    k = np.arange(6)
    binomials = np.array([math.comb(5, int(j)) for j in k])
    return np.asarray(np.linalg.inv(binomials * t**k * (1.0 - t) ** (5 - k)), dtype=np.float64)


def _edges_inside(camera: UnifiedCamera, polygon: FloatArray, low: FloatArray, high: FloatArray) -> bool:
    """Prove that the image of every edge lies in the rectangle; False where the proof does not succeed."""
    along = np.roll(polygon, -1, axis=0) - polygon
    t = (np.arange(_PIECES)[:, None] + np.linspace(0.0, 1.0, 6)) / _PIECES
    samples = distort(camera, polygon[:, None, None] + t[..., None] * along[:, None, None])
    coefficients = np.einsum("ij,epjc->epic", _bernstein_from_samples(), samples)
    lowest, highest = coefficients.min(axis=(0, 1, 2)), coefficients.max(axis=(0, 1, 2))
    return bool((lowest >= low + _TOLERANCE_PX).all() and (highest <= high - _TOLERANCE_PX).all())
