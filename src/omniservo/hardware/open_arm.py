"""Opening an arm by its driver's name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.metadata import entry_points

from omniservo.errors import InputError, did_you_mean, spelled
from omniservo.field_docs import with_field_docs
from omniservo.files import python_class
from omniservo.hardware.arm_connection import ArmConnection
from omniservo.robots import Arm

GROUP = "omniservo.drivers"
"""The entry points under which installed packages offer drivers."""

OWN = ("rtde", "ros2")
"""drivers of this package"""


@with_field_docs
@dataclass(frozen=True)
class ArmAddress:
    """Which arm, and how it is reached: what a process needs to open it."""

    driver: str
    """rtde, ros2, the name of an installed driver, or ``FILE.py:CLASS``, whose code is run"""
    address: str
    """the driver's: a host; of ros2 DOMAIN, or DOMAIN@INTERFACE"""
    joint_names: tuple[str, ...]
    """the driver's names of the joints, in the order of all arrays"""
    arm: Arm
    """its kinematics and limits"""
    watchdog: float | None = None
    """something of the user's own stops the arm so long after the last command [s]; None: nothing does"""
    options: Mapping[str, bool | float | int | str] = field(default_factory=dict)
    """further arguments of the driver"""

    def open(self) -> ArmConnection:
        """Connect, and return once a first state is there.

        Raises:
            InputError: no such driver, or an argument that it does not take; no one at the address.
            ConnectionLost: the connection was lost before the first state.
        """
        driver = _driver_named(self.driver)
        arguments: tuple[object, ...] = self.address, self.joint_names
        if self.driver == "ros2":
            arguments = (*arguments, self.arm, self.watchdog)
        try:
            inspect.signature(driver).bind(*arguments, **self.options)
        except TypeError as error:
            raise InputError(f"options: the driver {self.driver}: {error}") from None
        return driver(*arguments, **self.options)


def _driver_named(name: str) -> Callable[..., ArmConnection]:
    """Return what connects to an arm."""
    if name == "rtde":
        from omniservo.hardware.rtde import RtdeArm

        return RtdeArm
    if name == "ros2":
        from omniservo.hardware.ros2.open_ros2 import open_ros2_arm

        return open_ros2_arm
    if ".py:" in name:
        return python_class(name, "driver")
    installed = {point.name: point for point in entry_points(group=GROUP)}
    if name not in installed:
        legal = (*OWN, *installed)
        raise InputError(
            f"driver: {spelled(name)} given; legal: {', '.join(legal)}, or --driver FILE.py:CLASS"
            f"{did_you_mean(name, legal)}"
        )
    found: Callable[..., ArmConnection] = installed[name].load()
    return found
