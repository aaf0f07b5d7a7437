"""Motion and structure from two views; pose from known points."""

from omniservo.estimation.estimate_known_target import estimate_known_target
from omniservo.estimation.estimate_pose import estimate_pose
from omniservo.estimation.estimate_two_view import estimate_two_view
from omniservo.estimation.estimate_views import estimate_views
from omniservo.estimation.further_view import FurtherView, candidate_views, further_view
from omniservo.estimation.known_displacements import KnownDisplacements
from omniservo.estimation.multi_view_estimate import MultiViewEstimate
from omniservo.estimation.pose_estimate import PoseEstimate
from omniservo.estimation.refinement.pose_refinement import refine_pose_kernel
from omniservo.estimation.refinement.refine_pose import PoseRefinement, refine_pose
from omniservo.estimation.two_view_estimate import TwoViewEstimate
from omniservo.estimation.uncertainty.joint_uncertainty import EstimateSamples, JointUncertainty
from omniservo.estimation.view_points import ViewPoints
from omniservo.estimation.view_scale import KnownPoints, ViewDistance

__all__ = [
    "EstimateSamples",
    "FurtherView",
    "JointUncertainty",
    "KnownDisplacements",
    "KnownPoints",
    "MultiViewEstimate",
    "PoseEstimate",
    "PoseRefinement",
    "TwoViewEstimate",
    "ViewDistance",
    "ViewPoints",
    "candidate_views",
    "estimate_known_target",
    "estimate_pose",
    "estimate_two_view",
    "estimate_views",
    "further_view",
    "refine_pose",
    "refine_pose_kernel",
]
