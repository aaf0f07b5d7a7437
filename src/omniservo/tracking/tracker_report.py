"""What one control step saw."""

from dataclasses import dataclass
from typing import Literal

from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray

Phase = Literal["path", "goal", "done"]


@with_field_docs
@dataclass(frozen=True, eq=False)
class TrackerReport:
    """The evidence behind one twist."""

    time: float
    """exposure of the image [s]"""
    w: float
    """path parameter at the exposure"""
    w_dot: float
    """ẇ at the exposure [1/s]"""
    phase: Phase
    """"path"; "goal" once the time law is finished; "done" once the stop criteria hold"""
    used: BoolArray
    """(n,) the points that the step used: seen, in the camera's domain, and not rejected by the gate"""
    reference_pixels: FloatArray
    """(n, 2) where the points should have been at the exposure [px]; NaN where the camera cannot see it"""
    error_px: float
    """rms distance of the used points to their reference [px]"""
    goal_error_px: float
    """rms distance of the used points to the goal image [px]"""
    pose: FloatArray
    """(7,): quaternion (x, y, z, w) and translation [m] of initial_T_camera, from this image alone"""
    filtered_pose: FloatArray
    """(7,) likewise, joined with the images before along the planned motion"""
    filtered_covariance: FloatArray
    """(6, 6) of (translation [m], rotation vector on the right [rad]) of the filtered pose; where two
    poses explain a small plane, about that which is followed"""
    pose_rms_px: float
    """rms distance of the used points to the projections from that pose [px]"""
    conditioning: float
    """of the interaction matrix, see `omniservo.servoing.control_law.solve_twist`"""
    limited: bool
    """the twist was scaled down to a speed limit"""

    @property
    def valid_count(self) -> int:
        """How many points the step used."""
        return int(self.used.sum())

    @property
    def initial_T_camera(self) -> RigidTransform:
        """The pose at the exposure that explains the image best, given the plan's points."""
        return RigidTransform.from_components(self.pose[4:], Rotation.from_quat(self.pose[:4]))
