"""How the drive process opens its arm: what crosses from one process to the other is how, not the arm."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.robots import Arm, ArmDriver
from omniservo.safety.safety_options import SafetyOptions


@with_field_docs
@dataclass(frozen=True)
class ArmOpener:
    """A class or function of a module, and its arguments by name.

    Raises:
        InputError: it cannot be sent to another process.
    """

    call: Callable[..., ArmDriver]
    """at a module's top level"""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """by name"""
    watchdog: float | None = None
    """after so long without a command the arm is known to stop by itself [s]; None: its driver says it"""
    joint_names: tuple[str, ...] | None = None
    """what the driver calls the arm's joints, in the arm's order; None: as the arm does"""

    def __post_init__(self) -> None:
        try:
            pickle.dumps((self.call, dict(self.arguments)))
        except Exception as error:
            raise InputError(
                f"opener: {spelled(self.call)} cannot be told another process ({error}); legal: a class or "
                "function at a module's top level, with arguments that can be pickled"
            ) from None

    def open(self, arm: Arm) -> ArmDriver:
        """Open the arm's driver.

        Raises:
            InputError: its joints are others, or in another order, than the arm's, or nothing stops it where
                commands end.
            ServoStop: there is no connection.
        """
        driver = self.call(**self.arguments)
        wanted = self.joint_names or arm.joint_names
        names = getattr(driver, "joint_names", wanted)
        if tuple(names) != wanted:
            driver.close()
            raise InputError(f"joint_names: the driver gives {list(names)}; the arm has {list(wanted)}")
        if self.watchdog is None and getattr(driver, "watchdog", None) is None:
            driver.close()
            raise InputError(
                "watchdog: the driver cannot promise that the arm stops when commands end; state a watchdog "
                "only where its controller has one"
            )
        return driver


@with_field_docs
@dataclass(frozen=True, eq=False)
class DriveSetup:
    """What the drive process is given when it begins."""

    opener: ArmOpener
    """opens the arm's driver"""
    arm: Arm
    """its kinematics and limits"""
    flange_T_camera: RigidTransform
    """how the camera sits on it"""
    options: SafetyOptions
    """what no motion may exceed"""
