"""Planning problems as files, format omniservo.problem/1 (JSON or YAML)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.camera_files.camera_files import read_model
from omniservo.camera_files.usual_error import with_error
from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.errors import InputError, spelled, spelled_name
from omniservo.files import file_inside
from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.planning.degrees import Degrees
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.planning.obstacles.obstacle_fields import obstacle_fields, obstacles_from_fields, only_fields
from omniservo.planning.stated_quaternion import ROTATION_FIELDS, stated_quaternion
from omniservo.planning.workspace import MOST_HALF_SPACES, Workspace

if TYPE_CHECKING:
    from omniservo.planning.planning_problem import PlanningProblem

P = TypeVar("P")

FORMAT = "omniservo.problem/1"

MOST_POINTS = 100_000
"""Target points, and obstacles, that a problem may have."""

_REQUIRED = ("format", "camera", "points", "goal")
OPTIONAL = (
    "obstacles",
    "clearance",
    "least_distance",
    "visibility_margin",
    "occlusion",
    "workspace",
    "degrees",
    "initial_velocity",
)
"""Fields that a problem file may have, and a file of obstacles."""


def read_problem(make: Callable[..., P], fields: Any, folder: Path | None, source: str) -> P:
    """Return the problem, made by ``make``, of a file's fields; messages start with ``source`` and the field.

    Raises:
        InputError: a field is missing, unknown or not legal.
    """
    try:
        if isinstance(fields, Mapping) and fields.get("format", FORMAT) != FORMAT:
            raise InputError(f"format: {spelled(fields['format'])} given; legal: {FORMAT!r}")
        only_fields(fields, _REQUIRED, OPTIONAL)
        given: dict[str, Any] = {
            name: fields[name] for name in ("clearance", "least_distance", "visibility_margin", "occlusion")
            if name in fields
        }  # fmt: skip
        if fields.get("workspace") is not None:
            given["workspace"] = _workspace(fields["workspace"])
        if fields.get("degrees") is not None:
            given["degrees"] = _within("degrees", lambda: _degrees(fields["degrees"]))
        if fields.get("initial_velocity") is not None:
            given["initial_velocity"] = fields["initial_velocity"]
        initial_T_goal, quaternion = _goal(fields["goal"])
        problem = make(
            camera=_camera(fields["camera"], folder),
            points=_listed("points", fields["points"], MOST_POINTS),
            initial_T_goal=initial_T_goal,
            obstacles=_obstacles(fields.get("obstacles", ()), folder),
            **given,
        )
        # Read from the rotation, its last digit could be another one than the file's.
        vars(problem)["goal_quaternion"] = frozen(-quaternion) if quaternion[3] < 0.0 else quaternion
        return problem
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def _degrees(value: Any) -> Degrees:
    return Degrees(**only_fields(value, (), ("rotation", "translation")))


def problem_fields(problem: PlanningProblem) -> dict[str, Any]:
    """Return the fields of a problem file with every default written out and the camera embedded."""
    fields: dict[str, Any] = {
        "format": FORMAT,
        "camera": problem.camera.to_dict(),
        "points": problem.points.tolist(),
        "goal": {
            "translation": problem.goal_translation.tolist(),
            "quaternion": problem.goal_quaternion.tolist(),
        },
        "obstacles": [obstacle_fields(o) for o in problem.obstacles],
        "clearance": problem.clearance,
        "least_distance": problem.least_distance,
        "visibility_margin": problem.visibility_margin,
        "occlusion": bool(problem.occlusion),
    }
    if problem.workspace is not None:
        fields["workspace"] = _workspace_fields(problem.workspace)
    fields["degrees"] = {
        "rotation": problem.degrees.rotation,
        "translation": problem.degrees.translation,
    }
    if problem.initial_velocity is not None:
        fields["initial_velocity"] = problem.initial_velocity.tolist()
    return fields


def _within(place: str, make: Any) -> Any:
    """Return make(), with ``place`` before the message of its InputError."""
    try:
        return make()
    except InputError as error:
        message = str(error)
        prefixed = message if message.startswith(place) else f"{place}.{message}"
        raise InputError(prefixed) from None


def _listed(name: str, value: Any, most: int) -> Any:
    """Return ``value`` if it is a list of bounded length, before anything is made of its items."""
    if not isinstance(value, list | tuple) and not hasattr(value, "shape"):
        raise InputError(f"{name}: {spelled(value)} given; a list is needed")
    if len(value) > most:
        raise InputError(f"{name}: {len(value)} given; legal: at most {most}")
    if name == "points" and len(value) == 0:
        raise InputError("points: empty; at least one target point is needed")
    return value


def _camera(value: Any, folder: Path | None) -> CentralModel:
    if isinstance(value, CentralModel):
        return value
    if not isinstance(value, str):
        return camera_from_dict(value, "camera")
    file = file_inside("camera", value, folder)
    try:
        found, source = read_model(file)
        return with_error(found, None, source)
    except InputError as error:
        name, message = spelled_name(value), str(error).removeprefix(str(file))
        raise InputError(f"camera: {name}{message}") from None


def _goal(value: Any) -> tuple[RigidTransform, FloatArray]:
    """Return the goal's pose, and its unit quaternion as it is written."""
    fields = _within("goal", lambda: only_fields(value, ("translation",), ROTATION_FIELDS))
    if not set(ROTATION_FIELDS) & set(fields):
        raise InputError("goal.quaternion: missing; needed: translation, and quaternion or rotation_vector")
    translation = finite_array("goal.translation", fields["translation"], (3,))
    quaternion = stated_quaternion(fields, "goal.")
    return RigidTransform.from_components(translation, Rotation.from_quat(quaternion)), quaternion


def _obstacles(value: Any, folder: Path | None) -> tuple[Obstacle, ...]:
    found = [
        _within(f"obstacles[{i}]", lambda item=item: obstacles_from_fields(item, folder))
        for i, item in enumerate(_listed("obstacles", value, MOST_POINTS))
    ]
    return tuple(obstacle for several in found for obstacle in several)


def _workspace(value: Any) -> Workspace:
    fields = _within("workspace", lambda: only_fields(value, (), ("min", "max", "half_spaces")))
    listed = _listed("workspace.half_spaces", fields.get("half_spaces", ()), MOST_HALF_SPACES)
    half_spaces = tuple(
        _within(f"workspace.half_spaces[{i}]", lambda item=item: _half_space(item))
        for i, item in enumerate(listed)
    )
    return Workspace(fields.get("min"), fields.get("max"), half_spaces)


def _half_space(value: Any) -> HalfSpace:
    return HalfSpace(**only_fields(value, ("normal", "offset"), ()))


def _workspace_fields(workspace: Workspace) -> dict[str, Any]:
    fields: dict[str, Any] = {}
    if workspace.min is not None and workspace.max is not None:
        fields = {"min": workspace.min.tolist(), "max": workspace.max.tolist()}
    if workspace.half_spaces:
        fields["half_spaces"] = [
            {"normal": side.normal.tolist(), "offset": side.offset} for side in workspace.half_spaces
        ]
    return fields
