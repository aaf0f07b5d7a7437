"""A connection to an arm whose driver need not be trusted to keep to its protocol."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from omniservo.robots import ArmDriver, RobotState
from omniservo.safety.robot_link import answered, checked_state


class CheckedConnection:
    """An `ArmConnection` through any driver: what is wrong with an answer is a stop by its name, as in a run.

    What else the driver has, such as its clock or notices, is found here too.

    Args:
        driver: of the arm.
        joint_names: in the order of all arrays.
    """

    def __init__(self, driver: ArmDriver, joint_names: tuple[str, ...]) -> None:
        self._driver = driver
        self.joint_names = joint_names
        """as given"""
        self.watchdog: float | None = getattr(driver, "watchdog", None)
        """the driver's [s]; None: it promises none"""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._driver, name)

    def read(self) -> RobotState:
        """Return the newest state.

        Raises:
            ServoStop: the driver's own; RobotLost: it raised something else; InvalidData, NotFinite: it gave
                no state of so many joints.
        """
        return checked_state(answered("read", self._driver.read), len(self.joint_names))

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Pass joint velocities (n,) [rad/s] on.

        Raises:
            ServoStop: the driver's own; RobotLost: it raised something else.
        """
        answered("command", lambda: self._driver.command(joint_velocities))

    def stop(self) -> None:
        """Brake; raises as `command`."""
        answered("stop", self._driver.stop)

    def close(self) -> None:
        """End the connection; raises as `command`."""
        answered("close", self._driver.close)
