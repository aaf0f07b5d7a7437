"""Tasks as files: what `load_task` reads back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from omniservo.errors import InputError
from omniservo.files import MOST_YAML_VALUES, write_whole
from omniservo.robots import shipped_arms
from omniservo.tasks.obstacles import ObstacleSection
from omniservo.tasks.task import FORMAT, Task

_UNSAVED = {"camera", "simulation", "planning", "arm"}

_MOST_IN_YAML = MOST_YAML_VALUES // 10
"""points of clouds and meshes; a task with more is JSON, of which more is read"""


def task_text(task: Task) -> str:
    """Return a task file: lengths in m, angles in rad, everything in the initial camera frame.

    It is YAML, or JSON where many points stand in it.

    An arm that does not ship with the package is named by its path; the file has to lie in its folder, and
    names the ROS packages that lie in it.

    Raises:
        InputError: what the task keeps in values, no file can name: a tracking tube.
    """
    fields: dict[str, Any] = {"format": FORMAT, **_dumped(task, exclude=_UNSAVED)}
    fields["camera"] = task.camera.to_dict()
    fields["simulation"] = _dumped(task.simulation, exclude={"true_camera"})
    if task.simulation.true_camera is not None:
        fields["simulation"]["true_camera"] = task.simulation.true_camera.to_dict()
    fields["arm"] = _dumped(task.arm)
    if task.arm.model not in shipped_arms():
        model = Path(task.arm.model)
        folders = {name: Path(folder) for name, folder in task.arm.packages.items()}
        inside = {name: f for name, f in folders.items() if f.is_relative_to(model.parent)}
        fields["arm"]["model"] = model.name
        fields["arm"]["packages"] = {n: str(f.relative_to(model.parent)) for n, f in inside.items()}
    if task.planning.tracking_tube is not None:
        raise InputError(
            f"{task.name}: planning.tracking_tube: a measured tube cannot be written into a task"
        )
    fields["planning"] = _dumped(task.planning, exclude={"obstacles", "arm_clearance"})
    fields["planning"]["arm_clearance"] = task.planning.arm_clearance
    fields["planning"]["obstacles"] = [
        {**_dumped(section, exclude={"file"}), "type": section.type} for section in task.planning.obstacles
    ]
    if sum(map(_coordinates, task.planning.obstacles)) > _MOST_IN_YAML:
        return json.dumps(fields)
    return yaml.safe_dump(fields, sort_keys=False, default_flow_style=None, allow_unicode=True, width=110)


def save_task(task: Task, path: str | Path, *, force: bool = False) -> None:
    """Write a task, whole or not at all.

    Raises:
        InputError: as `task_text`; or the file exists and ``force`` is False.
    """
    write_whole(path, task_text(task), force=force)


def _coordinates(section: ObstacleSection) -> int:
    return len(getattr(section, "points", getattr(section, "vertices", ())))


def _dumped(section: Any, exclude: set[str] | None = None) -> dict[str, Any]:
    """Return a section's fields by their names in a file, without those that are as by default."""
    found: dict[str, Any] = section.model_dump(
        mode="json", by_alias=True, exclude_defaults=True, exclude=exclude
    )
    return found
