"""What the page plans for: an immutable value, and the changes that a hand makes to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.geometry.along import along
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Box, Capsule, Cloud, Cylinder, Ellipsoid, HalfSpace, Mesh, PlanningProblem
from omniservo.planning.obstacles.obstacle import Obstacle, hides_points
from omniservo.replanning.frame_change import problem_from, seen_from
from omniservo.scenes import Scene
from omniservo.tasks import Task
from omniservo.viewer.uncertain_target import UncertainTarget
from omniservo.whole_arm import ArmSetting
from omniservo.whole_arm.solids_of import solids_of

_STILL = 1e-12
"""Poses that differ by less are the same."""


@dataclass(frozen=True, eq=False)
class ArmInScene:
    """The arm of a task, and what stands around it beside the planner's obstacles."""

    task: Task
    """as it was read"""
    scene: Scene
    """its obstacles are those bodies alone that no obstacle of the planner coincides with"""
    setting: ArmSetting
    """of the arm where the situation has its initial camera"""


@dataclass(frozen=True, eq=False)
class Situation:
    """A planning problem, where its initial camera stands, and the arm that carries it, if any."""

    problem: PlanningProblem
    world_T_initial: RigidTransform
    arm: ArmInScene | None = None
    bodies: frozenset[int] = frozenset()
    """obstacles of the problem that also stand in the task as bodies"""
    uncertain: UncertainTarget | None = None
    """what target and goal were estimated by; None: they are as exact as stated, or were moved"""
    risk: float = 0.0
    """that the servo, led by that estimate, may violate a constraint; 0: the estimate is taken as exact"""

    @property
    def world_T_goal(self) -> RigidTransform:
        """The goal camera in the world."""
        return self.world_T_initial * self.problem.initial_T_goal

    @cached_property
    def handles(self) -> tuple[RigidTransform, ...]:
        """Each obstacle's own frame in the world: what it is moved by."""
        return tuple(self.world_T_initial * obstacle_pose(o) for o in self.problem.obstacles)

    @cached_property
    def world_scene(self) -> Scene | None:
        """The scene with the planner's obstacles as bodies; None without an arm.

        Obstacles that are points hide nothing and are no bodies.
        """
        if self.arm is None:
            return None
        hiding = (o for o in self.problem.obstacles if hides_points(o) or isinstance(o, HalfSpace))
        still = tuple(replace(o, motion=None) for o in hiding)
        named = (replace(s, name=f"known {s.name}") for s in solids_of(still, self.world_T_initial))
        return replace(self.arm.scene, solids=tuple(named))

    @property
    def camera(self) -> CentralModel:
        """The camera as the task states it, where it was not changed; else the problem's."""
        return self.problem.camera if self.arm is None else self.arm.scene.camera

    def moved(
        self,
        start: RigidTransform | None = None,
        goal: RigidTransform | None = None,
        handles: Mapping[int, RigidTransform] | None = None,
    ) -> Situation:
        """Return it with the initial camera, the goal or obstacles elsewhere in the world; all else stays.

        Raises:
            InputError: the arm cannot bring the camera to its start.
        """
        problem = self.problem
        changes: dict[str, Any] = {}
        obstacles = list(problem.obstacles)
        for i, pose in (handles or {}).items():
            change = self.world_T_initial.inv() * pose * self.handles[i].inv() * self.world_T_initial
            if not _same(pose, self.handles[i]):
                obstacles[i] = seen_from(obstacles[i], change, 0.0)
        if any(new is not old for new, old in zip(obstacles, problem.obstacles, strict=True)):
            changes["obstacles"] = tuple(obstacles)
        if goal is not None and not _same(goal, self.world_T_goal):
            changes["initial_T_goal"] = self.world_T_initial.inv() * goal
        found = self.with_problem(**changes) if changes else self
        if start is None or _same(start, self.world_T_initial):
            return found
        return found._started_at(start)

    def _started_at(self, world_T_initial: RigidTransform) -> Situation:
        here = self.world_T_initial.inv() * world_T_initial
        problem = problem_from(self.problem, here, 0.0, None)
        exact = replace(self, problem=problem, uncertain=None, risk=0.0)
        if self.arm is None:
            return replace(exact, world_T_initial=world_T_initial)
        scene = self.arm.scene
        try:
            joints = scene.joints_for(world_T_initial, scene.start_joints)
        except InputError as error:
            raise InputError(f"the arm cannot start there: {error}") from None
        return exact.moved_as_a_whole(world_T_initial, joints)

    def moved_as_a_whole(self, world_T_initial: RigidTransform, joints: FloatArray) -> Situation:
        """Return the same problem as it is where the arm (n,) [rad] has its initial camera elsewhere."""
        if self.arm is None:
            return replace(self, world_T_initial=world_T_initial)
        scene, setting = replace(self.arm.scene, start_joints=joints), self.arm.setting
        base_T_initial = scene.world_T_base.inv() * world_T_initial
        arm = replace(
            self.arm, scene=scene, setting=replace(setting, base_T_initial=base_T_initial, start=joints)
        )
        return replace(self, world_T_initial=world_T_initial, arm=arm)

    def with_problem(self, **changes: Any) -> Situation:
        """Return it with fields of the problem changed, the camera in all places.

        Raises:
            InputError: a field that is not legal.
        """
        arm = self.arm
        if "camera" in changes and arm is not None:
            arm = replace(arm, scene=replace(arm.scene, camera=changes["camera"]))
        found = replace(self, problem=replace(self.problem, **changes), arm=arm)
        estimated = {"camera", "points", "initial_T_goal"} & changes.keys()
        return replace(found, uncertain=None, risk=0.0) if estimated else found

    def with_risk(self, risk: float) -> Situation:
        """Return it with a risk that the plan may have.

        Raises:
            InputError: target and goal are no estimate with its uncertainty.
        """
        if risk > 0.0 and self.uncertain is None:
            raise InputError(
                "risk: target and goal are taken as exact; open the folder of a run, or give two images"
            )
        return replace(self, risk=risk)

    def with_obstacle(self, i: int, obstacle: Obstacle) -> Situation:
        """Return it with another obstacle in the place of one."""
        obstacles = list(self.problem.obstacles)
        obstacles[i] = obstacle
        return self.with_problem(obstacles=tuple(obstacles))

    def with_added(self, obstacle: Obstacle) -> Situation:
        """Return it with one more obstacle; a box becomes a body of the task, too."""
        count = len(self.problem.obstacles)
        found = self.with_problem(obstacles=(*self.problem.obstacles, obstacle))
        return replace(found, bodies=self.bodies | {count}) if isinstance(obstacle, Box) else found

    def without(self, i: int) -> Situation:
        """Return it without one of the obstacles."""
        kept = [k for k in range(len(self.problem.obstacles)) if k != i]
        found = self.with_problem(obstacles=tuple(self.problem.obstacles[k] for k in kept))
        return replace(found, bodies=frozenset(n for n, k in enumerate(kept) if k in self.bodies))


def with_xi(camera: UnifiedCamera, xi: float) -> UnifiedCamera:
    """Return the camera with another ξ that shows the middle of its image as large as before."""
    share = (1.0 + xi) / (1.0 + camera.xi)
    fields = camera.to_dict()
    changed = {name: share * fields[name] for name in ("fx", "fy", "skew")}
    return UnifiedCamera.from_dict(fields | changed | {"xi": xi})


def obstacle_pose(obstacle: Obstacle) -> RigidTransform:
    """Return an obstacle's own frame in the frame that it is stated in: in its middle, along its axes."""
    match obstacle:
        case Box() | Ellipsoid():
            turn = Rotation.from_quat(np.array(obstacle.quaternion))
            return RigidTransform.from_components(obstacle.center, turn)
        case Capsule() | Cylinder():
            turn = along(obstacle.end - obstacle.start)
            return RigidTransform.from_components(0.5 * (obstacle.start + obstacle.end), turn)
        case HalfSpace():
            foot = obstacle.offset * np.array(obstacle.normal)
            return RigidTransform.from_components(foot, along(np.array(obstacle.normal)))
        case Mesh():
            return RigidTransform.from_translation(obstacle.vertices.mean(axis=0))
        case Cloud():
            return RigidTransform.from_translation(obstacle.points.mean(axis=0))
    return RigidTransform.from_translation(np.array(obstacle.center))


def _same(a: RigidTransform, b: RigidTransform) -> bool:
    return bool(np.abs(a.as_matrix() - b.as_matrix()).max() < _STILL)
