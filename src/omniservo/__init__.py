"""Certified visual-servo path planning for every central camera.

The public names are imported when they are first used, so that ``import omniservo`` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from omniservo.calibration import Calibration, calibrate_camera
    from omniservo.calibration.hand_eye import (
        HandEye,
        RobotPoses,
        calibrate_hand_eye,
        calibrate_hand_eye_images,
        load_robot_poses,
    )
    from omniservo.camera_files import load_camera, load_model, save_camera
    from omniservo.cameras import DeadZone, UnifiedCamera, preset, rectify, tangent_view
    from omniservo.errors import InputError, NoSolutionError, OmniservoError, ServoStop
    from omniservo.estimation import (
        KnownDisplacements,
        KnownPoints,
        MultiViewEstimate,
        PoseEstimate,
        TwoViewEstimate,
        ViewDistance,
        ViewPoints,
        estimate_known_target,
        estimate_pose,
        estimate_two_view,
        estimate_views,
    )
    from omniservo.planning import CameraPath, Certificate, Plan, PlanningProblem, improving_plans, plan_path
    from omniservo.replanning import replan
    from omniservo.risk import plan_with_risk
    from omniservo.simulation.render import ModelRenderer, Rendering, render
    from omniservo.targets import Target
    from omniservo.tracking import PathTracker, TrackerOptions
    from omniservo.verification import verify_plan

__version__ = "0.1.0"

_HOME = {
    "Calibration": "calibration",
    "calibrate_camera": "calibration",
    "HandEye": "calibration.hand_eye",
    "RobotPoses": "calibration.hand_eye",
    "calibrate_hand_eye": "calibration.hand_eye",
    "calibrate_hand_eye_images": "calibration.hand_eye",
    "load_robot_poses": "calibration.hand_eye",
    "load_camera": "camera_files",
    "load_model": "camera_files",
    "save_camera": "camera_files",
    "DeadZone": "cameras",
    "UnifiedCamera": "cameras",
    "preset": "cameras",
    "rectify": "cameras",
    "tangent_view": "cameras",
    "NoSolutionError": "errors",
    "InputError": "errors",
    "OmniservoError": "errors",
    "ServoStop": "errors",
    "KnownDisplacements": "estimation",
    "KnownPoints": "estimation",
    "MultiViewEstimate": "estimation",
    "PoseEstimate": "estimation",
    "TwoViewEstimate": "estimation",
    "ViewDistance": "estimation",
    "ViewPoints": "estimation",
    "estimate_known_target": "estimation",
    "estimate_pose": "estimation",
    "estimate_two_view": "estimation",
    "estimate_views": "estimation",
    "CameraPath": "planning",
    "Certificate": "planning",
    "Plan": "planning",
    "PlanningProblem": "planning",
    "improving_plans": "planning",
    "plan_path": "planning",
    "plan_with_risk": "risk",
    "replan": "replanning",
    "ModelRenderer": "simulation.render",
    "Rendering": "simulation.render",
    "render": "simulation.render",
    "Target": "targets",
    "PathTracker": "tracking",
    "TrackerOptions": "tracking",
    "verify_plan": "verification",
}

__all__ = [
    "Calibration",
    "CameraPath",
    "Certificate",
    "DeadZone",
    "HandEye",
    "InputError",
    "KnownDisplacements",
    "KnownPoints",
    "ModelRenderer",
    "MultiViewEstimate",
    "NoSolutionError",
    "OmniservoError",
    "PathTracker",
    "Plan",
    "PlanningProblem",
    "PoseEstimate",
    "Rendering",
    "RobotPoses",
    "ServoStop",
    "Target",
    "TrackerOptions",
    "TwoViewEstimate",
    "UnifiedCamera",
    "ViewDistance",
    "ViewPoints",
    "calibrate_camera",
    "calibrate_hand_eye",
    "calibrate_hand_eye_images",
    "estimate_known_target",
    "estimate_pose",
    "estimate_two_view",
    "estimate_views",
    "improving_plans",
    "load_camera",
    "load_model",
    "load_robot_poses",
    "plan_path",
    "plan_with_risk",
    "preset",
    "rectify",
    "render",
    "replan",
    "save_camera",
    "tangent_view",
    "verify_plan",
]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__} - {"TYPE_CHECKING", "import_module"})


def __getattr__(name: str) -> object:
    if name == "AnswerIsNo":
        return import_module("omniservo.errors").AnswerIsNo
    if name not in _HOME:
        raise AttributeError(f"module 'omniservo' has no attribute {name!r}")
    return getattr(import_module(f"omniservo.{_HOME[name]}"), name)
