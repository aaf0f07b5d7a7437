"""Motion and structure from two views; pose from known points."""

from omniservo.estimation.estimate_known_target import estimate_known_target
from omniservo.estimation.estimate_pose import estimate_pose
from omniservo.estimation.estimate_two_view import estimate_two_view
from omniservo.estimation.joint_uncertainty import EstimateSamples, JointUncertainty
from omniservo.estimation.pose_estimate import PoseEstimate
from omniservo.estimation.pose_refinement import PoseRefinement, refine_pose, refine_pose_kernel
from omniservo.estimation.two_view_estimate import TwoViewEstimate

__all__ = [
    "EstimateSamples",
    "JointUncertainty",
    "PoseEstimate",
    "PoseRefinement",
    "TwoViewEstimate",
    "estimate_known_target",
    "estimate_pose",
    "estimate_two_view",
    "refine_pose",
    "refine_pose_kernel",
]
