"""One look of a run: a small move, an image, and what it changed."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True)
class Known:
    """What an estimate leaves uncertain, standard deviations, and what planning with it came to."""

    goal_m: float
    """of the goal's place [m]"""
    goal_rad: float
    """of the goal's direction [rad]"""
    points_m: float
    """of the points, root mean square [m]"""
    violated: float | None
    """share of the samples that violate the best attempt, 95% bound; None: none was executed"""
    outcome: str
    """why there is no plan; "" where there is one"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class TakenLook:
    """One of them."""

    moved_m: float
    """of the camera's centre [m]"""
    turned_rad: float
    """of the camera [rad]"""
    motion_seconds: float
    """that the move took, on the robot's clock"""
    computing_seconds: float
    """that choosing it and joining its image took"""
    clearance_m: float
    """what is proven of every gap on the way beyond what is required [m]"""
    expected: float
    """of the uncertainty (see `uncertainty_size`), the share that was expected to be left"""
    gained: float
    """the share that is left"""
    leads_to_plan: bool
    """whether a plan was expected from there"""
    before: Known
    after: Known
    image: ByteArray
    """(height, width) that was taken there"""
    nothing: str = ""
    """why its image gave nothing, and the arm went back; "": it was joined"""

    __repr__ = short_repr
