"""A run with seven joints; their numbers in metrics.json, against the run's own log and plan."""

import numpy as np
import pytest
from tests.runs.changed_task import PlainCell

from omniservo.reporting.signals import joint_velocities
from omniservo.runs import run_task
from omniservo.tasks import load_task
from omniservo.tasks.sensor import SensorSection

pytestmark = pytest.mark.slow  # each needs a whole run


@pytest.fixture(scope="module")
def hurried():
    """The Panda as fast as half of its limits let it."""
    task = load_task("panda-table")
    servo = task.servo.model_copy(update={"time_law": "time-optimal", "image_speed": 300.0})
    sensor = SensorSection(rate=10.0)  # pictures take most of the time
    return run_task(task.model_copy(update={"servo": servo, "sensor": sensor}), PlainCell, filmed=False)


def test_a_hurried_run_arrives_within_half_of_the_joints_limits_and_the_image_speed(hurried):
    metrics = hurried.metrics
    assert (metrics["status"], metrics["contacts"]) == ("converged", [])
    assert metrics["clearance_executed_m"] >= hurried.task.planning.clearance
    assert metrics["joint_speed_share"] <= 0.5
    assert metrics["joint_acceleration_share"] <= 0.5
    assert metrics["image_speed_planned_px_s"] <= 300.0
    assert metrics["motion_seconds"] == pytest.approx(metrics["time_optimal_seconds"], rel=1e-5)
    assert metrics["motion_seconds"] < 2.0


def test_seven_joints_reach_the_goal_and_are_drawn(hurried):
    assert hurried.metrics["final_translation_error_m"] <= 0.3e-3
    assert hurried.metrics["arm_clearance_executed_m"] >= 0.005
    joints = hurried.log.column("joints")
    assert joints.shape[1] == 7
    # also in what the camera leaves free: the whole arm's proof is of these joints
    assert np.abs(joints[-1] - hurried.motion.joints(1.0)).max() < 0.01
    assert len(joint_velocities(hurried).figure.axes[0].lines) == 7


def test_joint_metrics_are_those_of_plan_and_log(hurried):
    metrics, motion = hurried.metrics, hurried.motion
    low, high = motion.arm.joint_range.T
    q = motion.joints(np.linspace(0.0, 1.0, 4001))
    assert metrics["joint_limit_margin_rad"] == pytest.approx(np.minimum(q - low, high - q).min(), abs=1e-6)
    assert metrics["singular_value_least"] == motion.joints.singular_values.min()
    time, read, joints = (hurried.log.column(name) for name in ("time", "read_time", "joints"))
    assert read - time == pytest.approx(hurried.task.sensor.latency)  # joints are read when an image arrives
    executed = np.abs(np.diff(joints, axis=0) / np.diff(time)[:, None]) / motion.arm.joint_speed
    assert metrics["joint_speed_share_executed"] == pytest.approx(executed.max())
    assert executed.max() < 1.0
