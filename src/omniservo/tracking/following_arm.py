"""The arm that a way planned again has to suit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from omniservo.field_docs import with_field_docs
from omniservo.planning import CameraPath
from omniservo.robots import JointPath
from omniservo.servoing import PathLimits
from omniservo.whole_arm import ArmSetting


@with_field_docs
@dataclass(frozen=True, eq=False)
class FollowingArm:
    """The arm that carries the camera along the plan."""

    setting: ArmSetting
    """with the plan's initial frame; what is proven of the plan is proven of what is planned later"""
    joints: JointPath
    """that follow the plan"""
    limits: Callable[[CameraPath, JointPath], PathLimits] | None
    """what a time law has to keep on another path, stated in the plan's frame; None: laws are carried on"""
    required: ArmSetting | None = None
    """what it has to keep where no way on is proven that keeps all of ``setting``; None: all of it"""
