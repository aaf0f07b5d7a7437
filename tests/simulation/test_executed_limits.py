"""What the joints really do: speed and acceleration limits hold at every millisecond of the physics."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.planning import CameraPath
from omniservo.robots import follow_path, load_arm
from omniservo.scenes import Scene
from omniservo.servoing import PathLimits, TimeOptimalLaw
from omniservo.simulation import SimulatedRobot

STARTS = {
    "rx60": [0.2, 0.6, -1.6, 0.1, 1.2, 0.0],
    "ur5e": [0.0, -1.5, 1.5, -1.5, -1.5, 0.1],
    "panda": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
}
FLANGE_T_CAMERA = RigidTransform.from_translation([0.0, 0.0, 0.09])
CURVE = CameraPath(
    [[0.02, 0.1, 0], [0.05, -0.1, 0], [0.1, 0.03, 0], [0, 0, 1]],
    [[0.05, -0.1, 0], [-0.1, 0.1, 0], [0, 0.1, 0]],
)


def robot_of(name):
    """The arm alone in the world."""
    arm = load_arm(name)
    scene = Scene(arm, RigidTransform.identity(), FLANGE_T_CAMERA, preset("fe185"), np.array(STARTS[name]))
    return arm, SimulatedRobot(scene)


def executed(robot, command, period, seconds):
    """Joint speeds at every millisecond, while ``command(time)`` is given each ``period`` [ms]."""
    speeds = [robot.read().joint_velocities]
    for tick in range(round(1e3 * seconds)):
        if tick % period == 0:
            robot.command(command(1e-3 * tick))
        robot.advance(1e-3)
        speeds.append(robot.read().joint_velocities)
    return np.array(speeds)


def shares(arm, speeds):
    """Largest share of the speed limits, and of the acceleration limits."""
    changes = np.abs(np.diff(speeds, axis=0)) / 1e-3
    return (np.abs(speeds) / arm.joint_speed).max(), (changes / arm.joint_acceleration).max()


@pytest.mark.parametrize("name", STARTS)
@pytest.mark.parametrize(("share", "period"), [(0.5, 1), (0.95, 1), (0.5, 33), (0.95, 33)])
def test_time_optimal_motion_keeps_the_limits_in_the_executed_log(name, share, period):
    """Each millisecond by the law itself: also the share it was allowed. Each 33 ms: the arm's own limits."""
    arm, robot = robot_of(name)
    base_T_initial = arm.base_T_flange(STARTS[name]) * FLANGE_T_CAMERA
    joints = follow_path(arm, CURVE, base_T_initial, FLANGE_T_CAMERA, start=STARTS[name]).best
    assert joints.feasible
    law = TimeOptimalLaw(PathLimits(joints, share * arm.joint_speed, share * arm.joint_acceleration))

    def command(time):
        w, rate = law(time + 0.5e-3 * period)
        return joints(w, 1) * rate

    speed, acceleration = shares(arm, executed(robot, command, period, law.duration + 0.2))
    allowed = share + 0.005 if period == 1 else 1.0
    assert speed <= share + 0.005
    assert acceleration <= allowed
    assert acceleration > 0.9 * share
    if period == 1:
        np.testing.assert_allclose(robot.read().joint_positions, joints(1.0), atol=2e-4)


@pytest.mark.parametrize("name", STARTS)
def test_wild_commands_are_executed_within_the_limits(name):
    arm, robot = robot_of(name)
    rng = np.random.default_rng(4)
    wild = executed(robot, lambda time: 0.5 * arm.joint_speed * rng.uniform(-1, 1, arm.dof), 33, 0.6)
    assert arm.within_limits(robot.read().joint_positions)
    speed, acceleration = shares(arm, wild)
    assert speed <= 0.505
    assert 0.9 < acceleration <= 1.0
