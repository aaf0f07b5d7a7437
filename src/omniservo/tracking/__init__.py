"""Following a plan by the image, and replanning: joins a plan and features."""

from omniservo.tracking.following_arm import FollowingArm
from omniservo.tracking.goal_servo import GoalServo, GoalServoOptions
from omniservo.tracking.leg import Leg
from omniservo.tracking.path_tracker import PathTracker
from omniservo.tracking.replan_options import ReplanOptions
from omniservo.tracking.replanner import Replanner
from omniservo.tracking.replanning import Replanning
from omniservo.tracking.tracker_options import TrackerOptions
from omniservo.tracking.tracker_report import TrackerReport

__all__ = [
    "FollowingArm",
    "GoalServo",
    "GoalServoOptions",
    "Leg",
    "PathTracker",
    "ReplanOptions",
    "Replanner",
    "Replanning",
    "TrackerOptions",
    "TrackerReport",
]
