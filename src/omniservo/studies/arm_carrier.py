"""A camera that an arm carries, driven as `omniservo run` drives it: through the supervisor."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray, finite_array
from omniservo.robots import CameraImage, RobotState
from omniservo.safety import SafetyOptions, Supervisor
from omniservo.safety.closed_loop import Posture, towards
from omniservo.studies.free_carrier import HOLD
from omniservo.studies.placed_arm import PlacedArm
from omniservo.studies.study import StudyServo
from omniservo.studies.trajectory import Trajectory

_ANY_AGE = 1e3
"""[s] How old an image may be is the study's to say: after `HOLD` without one the arm is led to rest."""
_NO_PIXELS = np.zeros((1, 1), dtype=np.uint8)


class ArmCarrier:
    """Moves the camera by the joint velocities of its twist, within the limits of the arm.

    Args:
        placed: the arm, where it stands.
        servo: states the speeds of the camera.
        posture: where an arm of seven joints is to be while the camera goes its way; None: anywhere.
        trajectory: takes in where it goes.
    """

    def __init__(
        self, placed: PlacedArm, servo: StudyServo, posture: Posture | None, trajectory: Trajectory
    ) -> None:
        arm = placed.arm
        self._driver = _Drives(placed, trajectory)
        self._wish = towards(posture, 0.0) if posture is not None and arm.dof > 6 else None
        options = SafetyOptions(
            image_age=_ANY_AGE, max_linear_speed=servo.linear_speed, max_angular_speed=servo.angular_speed
        )
        mount = placed.stated.flange_T_camera.transform
        driver = self._driver
        self._supervisor = Supervisor(driver, arm, mount, camera=driver, wait=driver.advance, options=options)
        self._since = 0.0

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) of initial_T_camera."""
        return self._driver.rotation

    @property
    def centre(self) -> FloatArray:
        """(3,) of the camera, in the initial camera frame [m]."""
        return self._driver.centre

    def carry(self, twist: FloatArray) -> None:
        """Move by this twist (6,) from now on, for `HOLD` at most.

        Raises:
            ServoStop: the arm cannot: a joint would leave its range, or it is singular.
        """
        self._since = self._driver.time
        self._supervisor.image()
        self._supervisor.carry(twist, self._wish)

    def move(self, until: float) -> None:
        """Let the arm move until a time [s].

        Raises:
            ServoStop: the motion may not go on; the arm stands by then.
        """
        held = self._since + HOLD
        if self._driver.time < held < until:
            self._wait(held)
            self._supervisor.command(np.zeros(len(self._driver.joints)))
        self._wait(until)

    def brake(self, stop: ServoStop) -> None:
        """Bring the arm to rest, as fast as its joints may."""
        if self._supervisor.stopped is None:
            self._supervisor.stop(stop)

    def _wait(self, until: float) -> None:
        if until > self._driver.time:
            self._supervisor.wait(until - self._driver.time)


class _Drives:
    """Joints that turn exactly as they are commanded; their camera's images are those of the study."""

    def __init__(self, placed: PlacedArm, trajectory: Trajectory) -> None:
        self._arm, self._mount = placed.arm, placed.flange_T_camera.as_matrix()
        self._initial_T_base = placed.base_T_initial.inv().as_matrix()
        self._trajectory = trajectory
        self.time = 0.0
        self.joints: FloatArray = np.array(placed.start)
        self.rotation: FloatArray = np.eye(3)
        self.centre: FloatArray = np.zeros(3)
        self._velocities = np.zeros(len(self.joints))
        self._note()

    def read(self) -> RobotState:
        return RobotState(self.time, self.joints, self._velocities)

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        self._velocities = finite_array("joint_velocities", joint_velocities, self.joints.shape).copy()

    def stop(self) -> None:
        self._velocities = np.zeros(len(self.joints))

    def image(self) -> CameraImage:
        return CameraImage(self.time, _NO_PIXELS)

    def close(self) -> None:
        self.stop()

    def advance(self, duration: float) -> None:
        """Let time [s] pass."""
        self.joints = self.joints + duration * self._velocities
        self.time += duration
        self._note()

    def _note(self) -> None:
        flange = np.vstack((self._arm.locate(self.joints)[0], [0.0, 0.0, 0.0, 1.0]))
        pose = self._initial_T_base @ flange @ self._mount
        self.rotation, self.centre = pose[:3, :3], pose[:3, 3]
        self._trajectory.note(self.time, self.rotation, self.centre)
        self._trajectory.joints.append(self.joints)
