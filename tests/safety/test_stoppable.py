"""Nothing is commanded that could not be stopped any more."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.errors import JointLimit, WorkspaceLimit
from omniservo.robots import Arm, ArmMode, RobotState
from omniservo.safety import SafetyOptions
from omniservo.safety.stoppable import Stoppable

JOINTS = np.array([0.0, 0.3, 1.2, 0.0, 0.6, 0.0])


@pytest.mark.parametrize("reaction", [0.02, 1e-3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_drive_that_still_turns_faster_than_commanded_is_braked_from_its_own_speed(sign, reaction):
    """What is commanded stops well before the wall, what the drive still does only behind it.

    With the longer reaction most of the way is gone before braking begins, with the shorter one after that.
    """
    arm = Arm.rx60()
    slow = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]) * sign
    jacobian = arm.camera_jacobian(JOINTS, RigidTransform.identity())
    start = arm.base_T_flange(JOINTS)
    axis = int(np.argmax(np.abs(jacobian[:3, 0])))

    def room(speed):
        return abs(jacobian[axis, 0]) * (speed * reaction + speed**2 / (2.0 * arm.joint_acceleration[0]))

    wall = 0.5 * (room(0.05) + room(0.5))
    options = SafetyOptions(workspace=[[-wall] * 3, [wall] * 3], reaction=reaction)
    stoppable = Stoppable(arm, RigidTransform.identity(), start, options)
    mode = ArmMode.READY
    stoppable.check(RobotState(0.0, JOINTS, slow, mode), slow)
    stoppable.check(RobotState(0.0, JOINTS, 10.0 * slow, mode), -slow)  # it may be brought back
    with pytest.raises(WorkspaceLimit, match="could stop only at"):
        stoppable.check(RobotState(0.0, JOINTS, 10.0 * slow, mode), slow)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_joint_that_still_turns_faster_than_commanded_is_braked_inside_its_range(sign):
    arm = Arm.rx60()
    options = SafetyOptions(joint_reserve=0.0, reaction=0.02)
    stoppable = Stoppable(arm, RigidTransform.identity(), arm.base_T_flange(JOINTS), options)

    def way(speed):
        return speed * options.reaction + speed**2 / (2.0 * arm.joint_acceleration[0])

    joints, slow = JOINTS.copy(), np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]) * sign
    joints[0] = arm.joint_range[0, int(sign > 0.0)] - 0.5 * sign * (way(0.05) + way(0.5))
    stoppable.check(RobotState(0.0, joints, slow, ArmMode.READY), slow)
    stoppable.check(RobotState(0.0, joints, 10.0 * slow, ArmMode.READY), -slow)  # it may be brought back
    with pytest.raises(JointLimit, match="would stop at"):
        stoppable.check(RobotState(0.0, joints, 10.0 * slow, ArmMode.READY), slow)
