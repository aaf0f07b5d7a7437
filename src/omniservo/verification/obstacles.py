"""The obstacles of a problem as exact numbers."""

from dataclasses import dataclass, field
from fractions import Fraction
from math import lcm

from omniservo.verification.bodies import Box, Capsule, axes_of
from omniservo.verification.cloud_tree import Node
from omniservo.verification.fields import Fields, Malformed, NotJudged, Vector, near_unit, numbers, shown
from omniservo.verification.mesh import Mesh, is_flat
from omniservo.verification.motion import Motion
from omniservo.verification.round_bodies import Cylinder, Ellipsoid
from omniservo.verification.work import bits, products, spend

FEWEST_VERTICES, MOST_VERTICES = 4, 1000
MOST_CLOUD_POINTS = 100_000
HIGHEST_MOTION = 16
_OBSTACLE = 1000
"""What reading one costs, in the unit of `work`."""
_KINDS = ("sphere", "box", "capsule", "cylinder", "ellipsoid", "half_space", "mesh", "cloud")


@dataclass(frozen=True)
class Sphere:
    """The ball ‖x − center‖ ≤ radius; of radius 0 a point, which hides nothing."""

    center: Vector
    radius: Fraction
    clearance: Fraction
    motion: Motion | None = None


@dataclass(frozen=True)
class HalfSpace:
    """The solid normal·x < offset, the normal taken as a unit vector."""

    normal: Vector
    offset: Fraction
    clearance: Fraction
    motion: Motion | None = None


@dataclass(frozen=True)
class Cloud:
    """Balls of one radius around the points; of radius 0 it hides nothing."""

    points: tuple[Vector, ...]
    unit: int
    """what the points must be multiplied by to become integers"""
    radius: Fraction
    clearance: Fraction
    motion: Motion | None = None
    trees: dict[int, Node] = field(default_factory=dict, compare=False, repr=False)
    """by scale, filled when they are needed"""


Obstacle = Sphere | HalfSpace | Box | Capsule | Cylinder | Ellipsoid | Mesh | Cloud
SEPARATED = (Box, Capsule, Cylinder, Ellipsoid, Mesh)
"""The kinds that are proven by separating planes, which the plan states."""


def obstacle(fields: Fields, clearance: Fraction) -> Obstacle:
    """Read one obstacle; without a clearance of its own it has the problem's."""
    spend(_OBSTACLE)
    kind = fields.get("type")
    if kind not in _KINDS:
        raise NotJudged(f"{fields.where}: this verifier does not judge obstacles of type {shown(kind)}")
    if fields.get("clearance") is not None:
        clearance = fields.number("clearance", least=0)
    motion = _motion(fields)
    if kind == "sphere":
        fields.only("type center radius clearance motion")
        return Sphere(fields.vector("center", 3), fields.number("radius", least=0), clearance, motion)
    if kind == "box":
        return _box(fields, clearance, motion)
    if kind == "capsule":
        fields.only("type from to radius clearance motion")
        ends, radius = (fields.vector("from", 3), fields.vector("to", 3)), fields.number("radius", above=0)
        return Capsule(*ends, radius, clearance, motion)
    if kind == "cylinder":
        return _cylinder(fields, clearance, motion)
    if kind == "ellipsoid":
        return _ellipsoid(fields, clearance, motion)
    if kind == "mesh":
        return _mesh(fields, clearance, motion)
    if kind == "cloud":
        return _cloud(fields, clearance, motion)
    fields.only("type normal offset clearance motion")
    return half_space(fields, clearance, motion)


def half_space(fields: Fields, clearance: Fraction, motion: Motion | None = None) -> HalfSpace:
    """Read normal and offset."""
    normal = near_unit(fields.vector("normal", 3), f"{fields.where}.normal")
    return HalfSpace(normal, fields.number("offset"), clearance, motion)


def _motion(fields: Fields) -> Motion | None:
    """Read three rows of coefficients [m], highest power of w first."""
    if fields.get("motion") is None:
        return None
    rows, where = fields.items("motion", 3), f"{fields.where}.motion"
    if len(rows) != 3 or not all(isinstance(row, list | tuple) for row in rows):
        raise Malformed(f"{where}: 3 rows of coefficients are needed")
    columns = len(rows[0])
    if not 1 <= columns <= HIGHEST_MOTION + 1:
        raise Malformed(f"{where}: degree {columns - 1} given; legal: 0 to {HIGHEST_MOTION}")
    return tuple(numbers(row, columns, f"{where}[{i}]") for i, row in enumerate(rows))


def _box(fields: Fields, clearance: Fraction, motion: Motion | None) -> Box:
    fields.only("type center quaternion half_extents clearance motion")
    extents = fields.vector("half_extents", 3)
    if min(extents) <= 0:
        raise Malformed(f"{fields.where}.half_extents: {fields.get('half_extents')} given; legal: > 0")
    axes = axes_of(near_unit(fields.vector("quaternion", 4), f"{fields.where}.quaternion"))
    return Box(fields.vector("center", 3), axes, extents, clearance, motion)


def _cylinder(fields: Fields, clearance: Fraction, motion: Motion | None) -> Cylinder:
    fields.only("type from to radius clearance motion")
    start, end = fields.vector("from", 3), fields.vector("to", 3)
    if sum((b - a) ** 2 for a, b in zip(start, end, strict=True)) == 0:
        raise Malformed(f"{fields.where}.to: the same as from; a length is needed")
    return Cylinder(start, end, fields.number("radius", above=0), clearance, motion)


def _ellipsoid(fields: Fields, clearance: Fraction, motion: Motion | None) -> Ellipsoid:
    fields.only("type center quaternion radii clearance motion")
    radii = fields.vector("radii", 3)
    if min(radii) <= 0:
        raise Malformed(f"{fields.where}.radii: {fields.get('radii')} given; legal: > 0")
    axes = axes_of(near_unit(fields.vector("quaternion", 4), f"{fields.where}.quaternion"))
    return Ellipsoid(fields.vector("center", 3), axes, radii, clearance, motion)


def _mesh(fields: Fields, clearance: Fraction, motion: Motion | None) -> Mesh:
    fields.only("type vertices clearance motion")
    vertices = fields.vectors("vertices", 3, MOST_VERTICES)
    if len(vertices) < FEWEST_VERTICES:
        raise Malformed(f"{fields.where}.vertices: {len(vertices)} given; at least {FEWEST_VERTICES}")
    scale = lcm(*{x.denominator for vertex in vertices for x in vertex})
    corners = [tuple(int(x * scale) for x in vertex) for vertex in vertices]
    longest = bits(x for corner in corners for x in corner)
    spend(products(64 * len(corners), longest, 2 * longest))
    if is_flat(corners):
        raise Malformed(f"{fields.where}.vertices: all in one plane; a solid is needed")
    return Mesh(tuple(corners), scale, clearance, motion)


def _cloud(fields: Fields, clearance: Fraction, motion: Motion | None) -> Cloud:
    fields.only("type points radius clearance motion")
    points = fields.vectors("points", 3, MOST_CLOUD_POINTS)
    if not points:
        raise Malformed(f"{fields.where}.points: empty; at least one point is needed")
    unit = lcm(*{x.denominator for point in points for x in point})
    return Cloud(points, unit, fields.number("radius", least=0), clearance, motion)
