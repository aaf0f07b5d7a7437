"""The numbers of metrics.json on joints and time."""

from __future__ import annotations

from omniservo.reporting.joint_figures import executed_speed_shares
from omniservo.results.run_result import RunResult
from omniservo.servoing import image_speed


def motion_metrics(result: RunResult) -> dict[str, object]:
    """Return what the plan asks of the joints, and what its time law makes of it; nothing without a plan.

    Shares are of the arm's own limits; of an acceleration that begins with a jump: None.
    """
    motion, plan = result.motion, result.plan
    if motion is None or plan is None or plan.path is None:
        return {}
    times = motion.times()
    w, speed = motion.pace(times)
    pixels = speed * image_speed(result.task.camera, plan.path, plan.problem.points, w)
    accelerations = motion.acceleration_shares(times)
    executed = executed_speed_shares(result.log, motion)[1]
    return {
        "joint_limit_margin_rad": float(motion.least_margins[0].min()),
        "singular_value_least": motion.least_singular_value[0],
        "joint_speed_share": float(motion.speed_shares(times).max()),
        "joint_acceleration_share": None if accelerations is None else float(accelerations.max()),
        "joint_speed_share_executed": float(executed.max()) if len(executed) else None,
        "image_speed_planned_px_s": float(pixels.max()),
        "motion_seconds": motion.seconds,
        "time_optimal_seconds": motion.time_optimal_seconds,
    }
