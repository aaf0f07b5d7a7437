"""The arm of a task, as its planner has to reckon with it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.quick_poses import composed
from omniservo.robots import CAMERA_HOUSING, Solid, Tube
from omniservo.scenes.scene import Scene
from omniservo.tasks import Task
from omniservo.whole_arm import ArmSetting

TUBE_SHARE = 0.01
"""of runs that may leave the tube, where a task states no risk"""

TRACKING_PART = 0.5
"""of a task's risk: that the run leaves the tube. The rest is the estimate's and the mount's."""


def arm_setting_of(task: Task, scene: Scene, *, with_tube: bool = True) -> ArmSetting:
    """Return arm and camera where they stand, on the floor, with the task's clearance and tracking margin.

    ``with_tube``: for visual servoing; False: for a move along a joint path.
    """
    planning, asked = task.planning, task.planning.arm_clearance
    setting = ArmSetting(
        arm=scene.arm,
        base_T_initial=task.base_T_initial,
        flange_T_camera=scene.flange_T_camera,
        start=scene.start_joints,
        mounted=CAMERA_HOUSING,
        surroundings=(*_floor(scene), *_standing(scene)),
        clearance=None if asked is None else asked + planning.tracking_margin,
        tube=tube_of(task) if with_tube else None,
    )
    return setting.servoed if with_tube else setting


def tube_of(task: Task) -> Tube | None:
    """Return how far the task's arm deviates, at its part of the risk; None where no tube is named."""
    measured, risk = task.planning.tracking_tube, task.planning.risk
    if measured is None:
        return None
    tube: Tube = measured.at(TUBE_SHARE if risk is None else TRACKING_PART * risk)
    return tube


def tracking_room_of(task: Task) -> float:
    """Return what a task's plans keep free because the arm does not follow exactly [m]."""
    tube = tube_of(task)
    return task.planning.tracking_margin if tube is None else tube.position


def _floor(scene: Scene) -> tuple[Solid, ...]:
    if scene.floor is None:
        return ()
    level = RigidTransform.from_translation([0.0, 0.0, scene.floor])
    return (Solid("floor", "half_space", np.zeros(0), composed(scene.world_T_base.inv(), level)),)


def _standing(scene: Scene) -> tuple[Solid, ...]:
    base_T_world = scene.world_T_base.inv()
    return tuple(
        Solid.box(body.name, composed(base_T_world, body.world_T_box), body.half_extents)
        for body in scene.surroundings
    )
