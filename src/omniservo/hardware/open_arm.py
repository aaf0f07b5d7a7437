"""Opening an arm by its driver's name."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import entry_points

from omniservo.errors import ConnectionLost, InputError, OmniservoError, did_you_mean, spelled
from omniservo.field_docs import with_field_docs
from omniservo.files import python_class
from omniservo.geometry.arrays import finite_number
from omniservo.robots import Arm, ArmDriver

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

    def open(self) -> ArmDriver:
        """Connect, and return once a first state is there; of our own drivers an `ArmConnection`.

        Raises:
            InputError: no such driver, or an argument that it does not take; no one at the address; what it
                gives is no driver, has other joints, or a watchdog that is no time.
            ConnectionLost: the connection was lost before the first state, or the driver cannot be opened.
        """
        driver = _driver_named(self.driver)
        arguments: tuple[object, ...] = self.address, self.joint_names
        if self.driver == "ros2":
            arguments = (*arguments, self.arm, self.watchdog)
        called = inspect.signature(driver)
        try:
            called.bind_partial(*arguments)
        except TypeError as error:
            raise InputError(
                f"driver: {self.driver}: {error}; legal: what takes address, joint_names and the options"
            ) from None
        try:
            called.bind(*arguments, **self.options)
        except TypeError as error:
            raise InputError(f"options: the driver {self.driver}: {error}") from None
        try:
            opened = driver(*arguments, **self.options)
        except OmniservoError:
            raise
        except Exception as error:  # of an installed or own driver: whatever it meets
            words = f"driver {self.driver}: cannot be opened: {type(error).__name__}: {error}"
            raise ConnectionLost(words) from error
        try:
            self._refuse_unfit(opened)
        except InputError:
            with suppress(Exception):  # it may be what is missing
                opened.close()
            raise
        return opened

    def _refuse_unfit(self, opened: ArmDriver) -> None:
        where = f"driver: {self.driver}"
        if not isinstance(opened, ArmDriver):
            raise InputError(
                f"{where}: gives a {type(opened).__name__}; legal: what has read, command, stop and close: "
                "omniservo.hardware.ArmConnection"
            )
        names = getattr(opened, "joint_names", self.joint_names)
        if not isinstance(names, list | tuple) or tuple(names) != self.joint_names:
            raise InputError(
                f"{where}: joint_names: {spelled(names)} given; legal: those that it was opened with, "
                f"{spelled(self.joint_names)}"
            )
        watchdog = getattr(opened, "watchdog", None)
        if watchdog is not None:
            finite_number(f"{where}: watchdog", watchdog, above=0.0)


def _driver_named(name: str) -> Callable[..., ArmDriver]:
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
    found: Callable[..., ArmDriver] = installed[name].load()
    return found
