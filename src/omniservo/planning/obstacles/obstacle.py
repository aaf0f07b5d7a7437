"""All kinds of obstacle."""

from omniservo.planning.obstacles.box import Box
from omniservo.planning.obstacles.capsule import Capsule
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.cylinder import Cylinder
from omniservo.planning.obstacles.ellipsoid import Ellipsoid
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.sphere import Sphere

Body = Sphere | Box | Capsule | Cylinder | Ellipsoid | Mesh
"""Convex and bounded: it has a `core`."""

Obstacle = Body | HalfSpace | Cloud

KINDS: dict[str, type[Obstacle]] = {
    "sphere": Sphere,
    "box": Box,
    "capsule": Capsule,
    "cylinder": Cylinder,
    "ellipsoid": Ellipsoid,
    "half_space": HalfSpace,
    "mesh": Mesh,
    "cloud": Cloud,
}
"""``type`` in a file; the class's FIELDS are the attribute of each field there."""


def hides_points(obstacle: Obstacle) -> bool:
    """Tell whether it can stand between camera and target: points cannot, and see `HalfSpace`."""
    if isinstance(obstacle, Sphere | Cloud):
        return obstacle.radius > 0.0
    return not isinstance(obstacle, HalfSpace)
