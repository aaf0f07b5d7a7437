"""What plans a task's way again while its arm moves."""

from __future__ import annotations

from dataclasses import replace

from omniservo.planning import CameraPath, Plan
from omniservo.risk import RiskPlan
from omniservo.robots import JointPath
from omniservo.runs.arm_setting_of import arm_setting_of, tracking_room_of
from omniservo.runs.pace import limits_of
from omniservo.safety import Controller
from omniservo.scenes.scene import Scene
from omniservo.servoing import PathLimits
from omniservo.tasks import Task
from omniservo.tracking import FollowingArm, PathTracker, Replanner, ReplanOptions
from omniservo.tracking.followed_way import FollowedWay
from omniservo.tracking.planned_motion import PlannedMotion


def replanner_of(
    task: Task,
    scene: Scene,
    plan: Plan | None,
    risk: RiskPlan | None,
    motion: PlannedMotion | None,
    controller: Controller,
    seed: int,
) -> Replanner | None:
    """Return the replanner of a plan that is about to be followed; None where nothing was planned.

    Another way is entered one period of the camera, and the delay until a twist acts, after the image with
    which planning began; time that passes in `RobotCell.wait` alone stands meanwhile. What the plan keeps
    because mount and estimate are uncertain is kept later, too, and nothing less is taken: what is uncertain
    of a newer estimate is not known, so of a path that keeps only what is required its risk is not.
    """
    if plan is None or motion is None or not isinstance(controller, PathTracker):
        return None
    setting = arm_setting_of(task, scene)
    if setting.clearance is not None and risk is not None and risk.links is not None:
        setting = replace(setting, clearance=setting.clearance + risk.links.added)

    def limits(path: CameraPath, joints: JointPath) -> PathLimits:
        return limits_of(task, scene.arm, path, joints, plan.problem.points)

    kept = None if task.servo.time_law == "exponential" else limits
    return Replanner(
        controller,
        plan,
        arm=FollowingArm(setting, motion.joints, kept),
        options=ReplanOptions.of_loop(task.sensor.rate, task.sensor.latency, tracking_room_of(task), seed),
    )


def followed_way(replanner: Replanner) -> FollowedWay:
    """Return the way that the arm was led on."""
    return FollowedWay(replanner.legs, tuple(joints for joints in replanner.joints if joints is not None))
