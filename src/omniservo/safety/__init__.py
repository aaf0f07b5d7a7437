"""What stands around every control step: the closed loop, its supervisor, and the visibility filter."""

from omniservo.safety.blind_motion import Waiting
from omniservo.safety.closed_loop import Controller, Step, TimeLimit, servo
from omniservo.safety.feature_watch import FeatureWatch
from omniservo.safety.joint_motion import OffPath, follow_joints
from omniservo.safety.path_controller import CarriedController, PathController
from omniservo.safety.robot_link import refuse_unready
from omniservo.safety.safety_options import SafetyOptions
from omniservo.safety.supervised_robot import SupervisedRobot
from omniservo.safety.supervisor import Passed, Supervisor
from omniservo.safety.visibility_filter import FilteredTwist, VisibilityFilter

__all__ = [
    "CarriedController",
    "Controller",
    "FeatureWatch",
    "FilteredTwist",
    "OffPath",
    "Passed",
    "PathController",
    "SafetyOptions",
    "Step",
    "SupervisedRobot",
    "Supervisor",
    "TimeLimit",
    "VisibilityFilter",
    "Waiting",
    "follow_joints",
    "refuse_unready",
    "servo",
]
