"""Following a plan by the image: the one place that joins a plan and features."""

from omniservo.tracking.goal_servo import GoalServo
from omniservo.tracking.path_tracker import PathTracker
from omniservo.tracking.tracker_options import TrackerOptions
from omniservo.tracking.tracker_report import TrackerReport

__all__ = ["GoalServo", "PathTracker", "TrackerOptions", "TrackerReport"]
