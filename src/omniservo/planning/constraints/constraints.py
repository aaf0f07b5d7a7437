"""What a path must keep, as arrays for kernels."""

from typing import NamedTuple

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.planning.constraints.hull_gap import Hull


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
