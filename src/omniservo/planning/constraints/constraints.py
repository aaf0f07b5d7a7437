"""What a path must keep, as arrays for kernels."""

from typing import NamedTuple, Self

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.planning.constraints.hull_gap import Hull

SPHERE_RADIUS, SPHERE_REACH = 3, 4
"""The places behind the centre in a row of `Constraints.obstacles`."""

FIRST_NODE, END_NODE, FIRST_POINT, END_POINT, CLOUD_RADIUS, CLOUD_REACH, CLOUD_MOTION = range(7)
"""The places of a row of `Constraints.clouds`."""


class Slots(NamedTuple):
    """Where each family's targets begin among those of a search, in this order, and how many there are."""

    limits: int
    dead_zone: int
    least_distance: int
    obstacles: int
    sights: int
    walls: int
    bodies: int
    body_sights: int
    planes: int
    masks: int
    clouds: int
    cloud_sights: int
    total: int


class Constraints(NamedTuple):
    """Everything that a proof, the search or a margin needs to know of a problem."""

    points: FloatArray
    """target points (n, 3) [m]"""
    limits: FloatArray
    """image limits (k, 4): unit n and κ of n·c ≤ κ‖c‖"""
    disc: FloatArray
    """dead zone (7,): fx, skew, fy, cu − u₀, cv − v₀, radius [px], ξ; (0,) where there is none"""
    mask_edges: FloatArray
    """edges of the mask's polygons (e, 5), see `image_mask`"""
    mask_firsts: IntArray
    """the first edge of each polygon, then e (p+1,)"""
    obstacles: FloatArray
    """spheres that stand still (m, 5): centre, radius, radius + clearance [m]"""
    bodies: FloatArray
    """bodies, among them spheres that move (b, 25), see `body_gap`"""
    hulls: Hull
    """vertices, faces and edges of all meshes, joined"""
    planes: FloatArray
    """half-spaces (p, 6): unit n, offset + clearance, clearance [m], motion; free where n·x ≥ offset; the
    obstacles', then the workspace's"""
    motions: FloatArray
    """(M, 3, K+1) [m], see `motion`"""
    clouds: FloatArray
    """point clouds (q, 7): first and end of its rows in ``cloud_nodes``, then in ``cloud_points``, radius,
    radius + clearance [m], motion"""
    cloud_points: FloatArray
    """of all clouds (P, 3) [m], in the order of their trees"""
    cloud_nodes: FloatArray
    """of all trees (N, 7), see `ball_tree`; rows in it count from the cloud's own first"""
    box: FloatArray
    """workspace (2, 3): least and greatest camera centre [m]; ±∞ where free"""
    least_distance: float
    """The camera centre keeps so far from every target point [m]."""
    occlusion: bool
    """Whether obstacles must not stand between the camera and a target point."""
    ell: float
    """ℓ, the mean distance of the target points [m]: what lengths are divided by in the search."""
    slots: Slots
    """see `with_slots`"""

    def with_slots(self) -> Self:
        """Return the same with the targets counted: one a row of a family's array, lines of sight apart."""
        counts = {
            "limits": len(self.limits),
            "dead_zone": 1,
            "least_distance": 1,
            "obstacles": len(self.obstacles),
            "sights": len(self.obstacles),
            "walls": 6,
            "bodies": len(self.bodies),
            "body_sights": len(self.bodies),
            "planes": len(self.planes),
            "masks": len(self.mask_firsts) - 1,
            "clouds": len(self.clouds),
            "cloud_sights": len(self.clouds),
            "total": 0,
        }
        firsts = {name: sum([*counts.values()][:i]) for i, name in enumerate(counts)}
        return self._replace(slots=Slots(**firsts))
