"""What moves an arm with a camera on it under supervision, in this process or another."""

from __future__ import annotations

from typing import Protocol

import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import ServoStop
from omniservo.robots import Arm, CameraImage, RobotState
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.safety_options import SafetyOptions
from omniservo.safety.supervisor import Passed, Wish


class SupervisedRobot(Protocol):
    """An arm and its camera as `Supervisor` has them; its docstrings say what each of these does."""

    @property
    def arm(self) -> Arm:
        """Its kinematics and limits."""
        ...

    @property
    def flange_T_camera(self) -> RigidTransform:
        """How the camera sits on it."""
        ...

    @property
    def options(self) -> SafetyOptions:
        """What no motion may exceed."""
        ...

    @property
    def history(self) -> MotionHistory:
        """What was sent and what was measured."""
        ...

    @property
    def stopped(self) -> ServoStop | None:
        """What the robot was stopped for, and has not been released from."""
        ...

    @property
    def time(self) -> float:
        """This instant on the clock of joints and images [s]."""
        ...

    def read(self) -> RobotState:
        """Return the newest reading of the joints."""
        ...

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives."""
        ...

    def command(self, joint_velocities: npt.ArrayLike) -> Passed:
        """Move with these joint velocities (n,) [rad/s], or as near to them as the limits allow."""
        ...

    def carry(self, twist: npt.ArrayLike, wish: Wish | None = None) -> Passed:
        """Move the camera with this twist (6,) (linear [m/s], angular [rad/s]; camera frame)."""
        ...

    def wait(self, duration: float) -> float:
        """Let time [s] pass under supervision; return how much did [s]."""
        ...

    def stop(self, reason: ServoStop | None = None) -> None:
        """Brake to standstill; what it is for latches."""
        ...

    def release(self, reason: str) -> None:
        """Let the robot move again after a stop for this reason."""
        ...
