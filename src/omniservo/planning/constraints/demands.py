"""What a path must keep, as arrays for kernels."""

from typing import NamedTuple

from omniservo.geometry.arrays import FloatArray


class Demands(NamedTuple):
    """Everything that a proof, the search or a margin needs to know of a problem."""

    points: FloatArray
    """target points (n, 3) [m]"""
    limits: FloatArray
    """image limits (k, 4): unit n and κ of n·c ≤ κ‖c‖"""
    disc: FloatArray
    """dead zone (7,): fx, skew, fy, cu − u₀, cv − v₀, radius [px], ξ; (0,) where there is none"""
    obstacles: FloatArray
    """spheres (m, 5): centre, radius, radius + clearance [m]"""
    bodies: FloatArray
    """boxes and capsules (b, 17), see `body_gap`"""
    planes: FloatArray
    """half-spaces (p, 5): unit n, offset + clearance, clearance [m]; free where n·x ≥ offset; the obstacles',
    then the workspace's"""
    clouds: FloatArray
    """point clouds (q, 6): first and end of its rows in ``cloud_nodes``, then in ``cloud_points``, radius,
    radius + clearance [m]"""
    cloud_points: FloatArray
    """of all clouds (P, 3) [m], in the order of their trees"""
    cloud_nodes: FloatArray
    """of all trees (N, 7), see `ball_tree`; rows in it count from the cloud's own first"""
    box: FloatArray
    """workspace (2, 3): least and greatest camera centre [m]; ±∞ where free"""
    numbers: FloatArray
    """(3,): least distance [m], 1 where occlusion counts, mean distance of the target points ℓ [m]"""
