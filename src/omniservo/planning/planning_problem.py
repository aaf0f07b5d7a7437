"""A planning problem: camera, target, goal, and what the path must keep."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.files import read_document, write_whole
from omniservo.geometry.arrays import FloatArray, finite_number, frozen, frozen_again
from omniservo.geometry.quick_poses import quaternion_of
from omniservo.geometry.single_pose import single_pose
from omniservo.planning.checks import LARGEST, bounded_array
from omniservo.planning.degrees import Degrees
from omniservo.planning.obstacles.cloud import MOST_CLOUD_POINTS, Cloud
from omniservo.planning.obstacles.obstacle import KINDS, Obstacle
from omniservo.planning.problem_file import MOST_POINTS, problem_fields, read_problem
from omniservo.planning.size_notices import size_notices
from omniservo.planning.workspace import Workspace


@with_field_docs
@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """Find a camera path from the initial frame to the goal that keeps every constraint for all w in [0, 1].

    Everything stands in the initial camera frame, in m. The defaults are those of the file format.

    Raises:
        InputError: any field that is not legal, named with what was given.
    """

    camera: UnifiedCamera
    """one of another model is taken in its unified form; what that leaves is a part of `image_margin`"""
    points: FloatArray
    """target points h_j (n, 3) [m], 1 ≤ n ≤ 1e5, read-only"""
    initial_T_goal: RigidTransform
    """goal camera frame in the initial camera frame"""
    obstacles: tuple[Obstacle, ...] = ()
    clearance: float = 0.0
    """camera centre to every obstacle's surface [m]; an obstacle may carry its own"""
    least_distance: float = 1e-3
    """camera centre to every target point [m]"""
    visibility_margin: float = 0.0
    """every target point to every image limit, and to the dead zone [px]; see `image_margin`"""
    occlusion: bool = False
    """no obstacle between camera and any target point"""
    workspace: Workspace | None = None
    degrees: Degrees = field(default_factory=Degrees)
    initial_velocity: FloatArray | None = None
    """twist that the path starts with (6,), (linear [m], angular [rad]) per unit of w, in the initial camera
    frame, read-only; None: any. It takes one degree more to leave a path as much freedom as without"""

    __setstate__ = frozen_again

    def __repr__(self) -> str:
        turn = np.rad2deg(self.initial_T_goal.rotation.magnitude())
        return (
            f"PlanningProblem({len(self.points)} points, {len(self.obstacles)} obstacles, "
            f"goal {np.linalg.norm(self.initial_T_goal.translation):.3g} m and {turn:.3g} deg away, "
            f"{type(self.camera).__name__} of {self.camera.width} × {self.camera.height} px)"
        )

    def __post_init__(self) -> None:
        self._take_unified_form()
        points = bounded_array("points", self.points, (None, 3))
        if not 1 <= len(points) <= MOST_POINTS:
            raise InputError(f"points: {len(points)} given; legal: 1 to {MOST_POINTS}")
        object.__setattr__(self, "points", points)
        self._check_goal()
        self._check_obstacles()
        for name in ("clearance", "least_distance", "visibility_margin"):
            value = finite_number(name, getattr(self, name), minimum=0.0, maximum=LARGEST)
            object.__setattr__(self, name, value)
        if not isinstance(self.occlusion, bool | np.bool_):
            raise InputError(f"occlusion: {spelled(self.occlusion)} given; legal: true or false")
        if self.workspace is not None and not isinstance(self.workspace, Workspace):
            raise InputError(f"workspace: {spelled(self.workspace)} given; a Workspace or None is needed")
        if not isinstance(self.degrees, Degrees):
            raise InputError(
                f"degrees: {spelled(self.degrees)} given; Degrees(rotation, translation) is needed"
            )
        self._check_velocity()

    def _take_unified_form(self) -> None:
        """Put the unified form in the place of a camera of another model."""
        given: Any = self.camera
        if not isinstance(given, CentralModel):
            raise InputError(f"camera: {type(given).__name__} given; a camera of any model is needed")
        conversion = to_unified(given)
        object.__setattr__(self, "camera", conversion.camera)
        object.__setattr__(self, "_cost", conversion.cost)

    @property
    def image_margin(self) -> float:
        """What every target point keeps to every image limit in the camera's own pixels [px], rounded up.

        The visibility margin, and how far the camera's pixels may lie from the true ones.
        """
        deviation = self.camera.deviation_px
        asked = self.visibility_margin
        return asked if deviation == 0.0 else math.nextafter(asked + deviation, math.inf)

    def _check_velocity(self) -> None:
        if self.initial_velocity is None:
            return
        velocity = bounded_array("initial_velocity", self.initial_velocity, (6,))
        object.__setattr__(self, "initial_velocity", velocity)
        for name in ("rotation", "translation"):
            degree = getattr(self.degrees, name)
            if degree < 2:
                raise InputError(
                    f"degrees.{name}: {degree} given with an initial_velocity; legal: at least 2, "
                    "and 3 to leave the path any freedom"
                )

    def _check_goal(self) -> None:
        goal = single_pose("initial_T_goal", self.initial_T_goal)
        bounded_array("goal.translation", goal.translation, (3,))

    def _check_obstacles(self) -> None:
        obstacles = tuple(self.obstacles)
        if len(obstacles) > MOST_POINTS:
            raise InputError(f"obstacles: {len(obstacles)} given; legal: at most {MOST_POINTS}")
        for i, obstacle in enumerate(obstacles):
            if not isinstance(obstacle, Obstacle):
                kind = type(obstacle).__name__
                raise InputError(
                    f"obstacles[{i}]: {kind} given; legal: {', '.join(k.__name__ for k in KINDS.values())}"
                )
        count = sum(len(o.points) for o in obstacles if isinstance(o, Cloud))
        if count > MOST_CLOUD_POINTS:
            raise InputError(
                f"obstacles: clouds of {count} points together given; legal: at most {MOST_CLOUD_POINTS}"
            )
        object.__setattr__(self, "obstacles", obstacles)

    @cached_property
    def goal_quaternion(self) -> FloatArray:
        """φ(1) (4,), (x, y, z, w), unit, w ≥ 0: by the short way round. By the long one φ ends at −φ(1).

        Read-only.
        """
        return frozen(quaternion_of(self.initial_T_goal))

    @cached_property
    def goal_translation(self) -> FloatArray:
        """t(1) (3,) [m], read-only."""
        return frozen(self.initial_T_goal.translation)

    @cached_property
    def notices(self) -> tuple[str, ...]:
        """What is odd in it, though legal: bodies that look as if their unit were another; a line each.

        And what it costs that the camera was given in another model than the unified one.
        """
        cost: str = vars(self)["_cost"]
        return (*filter(None, [cost]), *size_notices(self))

    @classmethod
    def load(cls, path: str | Path) -> PlanningProblem:
        """Return the problem of a JSON or YAML file. A camera path in it is relative, inside its folder.

        Raises:
            InputError: not readable, or a field is missing, unknown or not legal.
        """
        return read_problem(cls, read_document(path), Path(path).parent, str(path))

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any], *, folder: str | Path | None = None) -> PlanningProblem:
        """Return the problem of a file's fields; ``folder`` is where a camera path in it is looked up.

        Raises:
            InputError: a field is missing, unknown or not legal.
        """
        return read_problem(cls, fields, None if folder is None else Path(folder), "problem")

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of a problem file, with the camera in it: complete by itself."""
        return problem_fields(self)

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the problem as JSON.

        Raises:
            InputError: the file exists and ``force`` is False, or cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=1) + "\n", force=force)
