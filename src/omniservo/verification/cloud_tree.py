"""Which points of a cloud a moving hull may come near to; the others are excluded exactly, many at once."""

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from math import hypot, inf
from typing import NamedTuple

from omniservo.verification.polynomials import Polynomial, bernstein, halves
from omniservo.verification.sphere import to_sight
from omniservo.verification.work import bits, spend

_LEAF, _DEEPEST, _STEPS = 8, 10, 4
_UNIT, _NODE = 1 << 24, 64
Integers = tuple[int, ...]
Point = tuple[float, ...]


class Node(NamedTuple):
    """Points of a cloud and the box around them; a single point has no branches.

    low, high: exact, in units of 1/scale. center, size, radius: in floating point [m], for hints.
    """

    low: Integers
    high: Integers
    branches: tuple["Node", ...]
    point: int
    center: Point
    size: float
    """the longest side"""
    radius: float
    """half the diagonal"""


class Hull(NamedTuple):
    """Control points/unit: a piece of the path, and of the target point's, lies in their hull."""

    points: list[Integers]
    unit: int
    floats: list[Point]
    """the control points [m], for hints"""
    size: float
    """the largest extent of the path's own [m]"""


class TooMuchWork(Exception):
    """More tests than are allowed."""


def tree(points: Sequence[Integers], indices: list[int], scale: int) -> Node:
    """Halve the points, in units of 1/scale, along the longest side of their box until few are left."""
    columns = [[points[i][k] for i in indices] for k in range(3)]
    low, high = tuple(map(min, columns)), tuple(map(max, columns))
    spend(len(indices) * (16 + (bits((*low, *high)) >> 8)))
    if len(indices) <= _LEAF or low == high:
        return _node(low, high, scale, tuple(_node(points[i], points[i], scale, point=i) for i in indices))
    axis = max(range(3), key=lambda k: high[k] - low[k])
    indices = sorted(indices, key=lambda i: points[i][axis])
    middle = len(indices) // 2
    halves = indices[:middle], indices[middle:]
    return _node(low, high, scale, tuple(tree(points, half, scale) for half in halves))


def _node(
    low: Integers, high: Integers, scale: int, branches: tuple[Node, ...] = (), point: int = -1
) -> Node:
    # Quotients of integers round once and are in metres: the integers themselves may be beyond floats.
    center = tuple((a + b) / (2 * scale) for a, b in zip(low, high, strict=True))
    sides = [(b - a) / scale for a, b in zip(low, high, strict=True)]
    return Node(low, high, branches, point, center, max(sides), hypot(*sides) / 2)


def near(
    root: Node, ends: Sequence[Sequence[Polynomial]], reach: Fraction, scale: int, count: Callable[[], None]
) -> Iterator[int]:
    """Yield the points that are not proven to stay away from the path and its lines of sight.

    Depth first: what is really too near comes soon.

    Args:
        root: the cloud.
        ends: the path, and for lines of sight the other end: three polynomials each, in the cloud's units.
        reach: the distance, in the same units.
        scale: how many of these units are a metre.
        count: is called before every test.
    """
    degree = max(len(p) for end in ends for p in end)
    one = bernstein([1] + [0] * (degree - 1))
    rows = [bernstein([*p, *[0] * (degree - len(p))]) for end in ends for p in end]
    stack = [(0, [one, *rows], [root])]
    while stack:
        depth, pieces, nodes = stack.pop()
        left = _left(_hull(pieces, scale), nodes, reach, count, split=depth == _DEEPEST)
        if depth == _DEEPEST:
            yield from (node.point for node in left)
        elif nodes := list(left):
            sides = zip(*map(halves, pieces), strict=True)
            stack += [(depth + 1, list(side), nodes) for side in sides]


def _hull(pieces: list[list[int]], scale: int) -> Hull:
    unit, rows = pieces[0][0], pieces[1:]
    points = dict.fromkeys(p for k in range(0, len(rows), 3) for p in zip(*rows[k : k + 3], strict=True))
    metre = unit * scale
    size = max(max(row) - min(row) for row in rows[:3]) / metre
    return Hull(list(points), unit, [tuple(x / metre for x in point) for point in points], size)


def _left(
    hull: Hull, nodes: list[Node], reach: Fraction, count: Callable[[], None], *, split: bool
) -> Iterator[Node]:
    """Yield what is not excluded: nodes that are smaller than the hull; with ``split`` single points only."""
    mean = [sum(column) / len(hull.floats) for column in zip(*hull.floats, strict=True)]
    longest = bits(x for point in hull.points for x in point) + bits((reach.numerator, reach.denominator))
    test = 32 + len(hull.points) * (24 + (longest >> 10)) + (longest * longest >> 16)
    stack = list(nodes)
    while stack:
        node = stack.pop()
        count()
        spend(test)
        if _apart(hull, node, _toward(hull.floats, mean, node), reach):
            continue
        if node.branches and (split or node.size > hull.size):
            stack += node.branches
        else:
            yield node


def _apart(hull: Hull, node: Node, normal: Integers | None, reach: Fraction) -> bool:
    """Is the whole box at least ``reach`` behind the plane that has the hull in front of it? Exactly."""
    if normal is None:
        return False
    x, y, z = normal
    front = min(x * a + y * b + z * c for a, b, c in hull.points)
    back = sum(n * (b if n > 0 else a) for n, a, b in zip(normal, node.low, node.high, strict=True))
    gap = (front - back * hull.unit) * reach.denominator
    return gap > 0 and gap * gap >= (reach.numerator * hull.unit) ** 2 * (x * x + y * y + z * z)


def _toward(hull: list[Point], mean: list[float], node: Node) -> Integers | None:
    """Return a direction from the box to the hull, nearly that of their distance; any direction is sound."""
    cx, cy, cz = node.center
    x, y, z = mean[0] - cx, mean[1] - cy, mean[2] - cz
    for _ in range(_STEPS):
        a, b, c = min(hull, key=lambda p: x * p[0] + y * p[1] + z * p[2])
        a, b, c = a - cx - x, b - cy - y, c - cz - z
        length = a * a + b * b + c * c
        share = -(x * a + y * b + z * c) / length if length > 0 else 0.0
        if not share > 0:
            break
        share = min(share, 1.0)
        x, y, z = x + share * a, y + share * b, z + share * c
    largest = max(abs(x), abs(y), abs(z))
    if not 0 < largest < inf:
        return None
    return round(x / largest * _UNIT), round(y / largest * _UNIT), round(z / largest * _UNIT)


def nearest(root: Node, start: Sequence[float], end: Sequence[float]) -> float:
    """Return the smallest distance of the points from a segment, in floating point, for messages only."""
    best, stack = inf, [(0.0, root)]
    while stack:
        bound, node = stack.pop()
        spend(_NODE)
        if bound >= best:
            continue
        if not node.branches:
            best = bound
        found = [(to_sight(start, end, b.center) - b.radius, b) for b in node.branches]
        stack += sorted(found, key=lambda pair: -pair[0])
    return best
