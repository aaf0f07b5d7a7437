"""Reading task files: the shipped ones by name, the user's by path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from omniservo.camera_files import named_model
from omniservo.cameras import PRESETS
from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.errors import InputError, did_you_mean, spelled, spelled_name
from omniservo.files import is_file, noting_reads, read_document, stated_units
from omniservo.robots import TrackingTube, shipped_arms, shipped_tube
from omniservo.shipped_tasks import task_file
from omniservo.tasks.fields_at import fields_at
from omniservo.tasks.obstacle_files import with_all_parts, with_obstacle_files
from omniservo.tasks.section import Section
from omniservo.tasks.start_at_joints import start_at_joints
from omniservo.tasks.task import FORMAT, Pose, Task
from omniservo.tasks.task_files import TaskFiles
from omniservo.tasks.task_sources import TaskSources


def load_task(
    task: str | Path,
    *,
    camera: str | Path | CentralModel | None = None,
    packages: Mapping[str, str | Path] | None = None,
    allow_outside: bool = False,
) -> Task:
    """Read a task: a shipped name or the path of a YAML file.

    Args:
        task: a name of `shipped_tasks`, or a file. A name wins over a file of the same name without ending.
        camera: replaces the task's: a preset's name, a calibration file or, of a file with several cameras or
            one that needs a `max_angle`, what `omniservo.camera_files.named_model` makes of it. Of any model.
        packages: folders of ROS packages by name, for the arm's meshes; they win over the task's own.
        allow_outside: whether the files that the task names may lie outside its folder. A task need not be
            trusted, and reads nothing elsewhere unless this says so.

    Raises:
        InputError: the file is not a valid task; the message names file, field, value and what is legal.
    """
    replacement = named_model(camera) if isinstance(camera, str | Path) else camera
    path = task_file(task)
    files = TaskFiles(str(task), path.parent, allow_outside)
    with noting_reads() as read:
        loaded = _from_file(path, files, replacement, packages)
    folders = {name: Path(folder).absolute() for name, folder in (packages or {}).items()}
    return loaded.read_from(TaskSources(path.absolute(), read, folders))


def _from_file(
    path: Path,
    files: TaskFiles,
    replacement: CentralModel | None,
    packages: Mapping[str, str | Path] | None,
) -> Task:
    document, source = read_document(path), files.source
    if not isinstance(document, dict):
        raise InputError(f"{source}: a task is a mapping of fields, not {type(document).__name__}")
    fields = dict(document)
    if fields.pop("format", None) != FORMAT:
        raise InputError(f"{source}: format: {document.get('format')!r} given; legal: {FORMAT!r}")
    context = stated_units(fields.pop("units", {}), source)
    fields["camera"] = replacement or found_camera("camera", fields.get("camera"), files)
    truth = fields.get("simulation")
    if isinstance(truth, dict) and truth.get("true_camera") is not None:
        lens = found_camera("simulation.true_camera", truth["true_camera"], files)
        fields["simulation"] = {**truth, "true_camera": lens}
    planning, stated = with_obstacle_files(fields.get("planning", {}), files, context["length"])
    fields["planning"] = planning
    if "moves" in fields:
        fields["moves"] = with_all_parts(fields["moves"], stated, source)
    if isinstance(fields.get("arm"), dict):
        fields["planning"] = _found_tube(fields.get("planning"), fields["arm"], files)
        fields["arm"] = found_mount(found_arm(fields["arm"], files, packages), files)
    try:
        if isinstance(fields.get("start"), dict) and isinstance(fields.get("arm"), dict):
            fields["start"] = _found_start(fields, context, source)
        return Task.model_validate(fields, context=context)
    except ValidationError as error:
        raise InputError(first_problem(error, source, Task, stated)) from None


def found_camera(field: str, value: Any, files: TaskFiles) -> CentralModel:
    """Return the camera, of any model, that a field states: its fields, a preset's name or a file's."""
    source = files.source
    if isinstance(value, dict):
        return camera_from_dict(value, source=f"{source}: {field}")
    if not isinstance(value, str):
        raise InputError(
            f"{source}: {field}: {value!r} given; legal: a preset's name, a calibration file, a camera"
        )
    if value in PRESETS:
        return PRESETS[value]
    path = files.path(field, value)
    if not is_file(path):
        raise InputError(
            f"{source}: {field}: {spelled(value)} is neither a file nor a preset: {', '.join(PRESETS)}"
            f"{did_you_mean(value, PRESETS)}"
        )
    return named_model(path)


def found_arm(
    arm: dict[str, Any], files: TaskFiles, packages: Mapping[str, str | Path] | None
) -> dict[str, Any]:
    """Return the section with paths in the place of those relative to the task's folder."""
    model, stated = arm.get("model", "rx60"), arm.get("packages", {})
    if not isinstance(model, str) or model in shipped_arms():
        return arm
    path = files.path("arm.model", model)
    if not is_file(path):
        raise InputError(
            f"{files.source}: arm.model: {spelled(model)} is neither a file nor a shipped arm: "
            f"{', '.join(shipped_arms())}{did_you_mean(model, shipped_arms())}"
        )
    if not isinstance(stated, dict) or not all(isinstance(folder, str) for folder in stated.values()):
        raise InputError(f"{files.source}: arm.packages: {spelled(stated)} given; legal: {{NAME: FOLDER, …}}")
    own = {name: str(files.path(f"arm.packages.{name}", folder)) for name, folder in stated.items()}
    given = {name: str(Path(folder).resolve()) for name, folder in (packages or {}).items()}
    return {**arm, "model": str(path), "packages": {**own, **given}}


def _found_start(fields: dict[str, Any], context: dict[str, float], source: str) -> Any:
    """Return the section with the camera's pose in the place of the arm's joints."""
    start = fields["start"]
    if "joints" not in start and "world_T_camera" in start:
        return start
    if set(start) != {"joints"}:
        raise InputError(
            f"{source}: start: {', '.join(map(spelled_name, start)) or 'nothing'} given; legal: joints, or "
            "world_T_camera with joints_near"
        )
    return start_at_joints(fields, context, source)


def _found_tube(planning: Any, arm: dict[str, Any], files: TaskFiles) -> Any:
    """Return the section with the tracking tube in the place of its name."""
    named = planning.get("tracking_tube") if isinstance(planning, dict) else None
    if not isinstance(named, str):
        return planning
    if named == "shipped":
        tube = shipped_tube(str(arm.get("model", "rx60")))
    else:
        tube = TrackingTube.load(files.path("planning.tracking_tube", named))
    return {**planning, "tracking_tube": tube}


def found_mount(arm: dict[str, Any], files: TaskFiles) -> dict[str, Any]:
    """Return the section with the camera's pose in the place of a hand-eye calibration's file."""
    for name in ("flange_T_camera", "tool_T_camera"):
        if isinstance(arm.get(name), str):
            from omniservo.calibration.hand_eye import load_hand_eye  # only tasks that name a file pay for it

            path = files.path(f"arm.{name}", arm[name])
            if not is_file(path):
                raise InputError(
                    f"{files.source}: arm.{name}: {spelled(arm[name])}: no such file; legal: one of "
                    "omniservo robot calibrate-hand-eye, or a pose, {translation: [x, y, z], "
                    "quaternion: [x, y, z, w]}"
                )
            flange_T_camera, covariance = load_hand_eye(path)
            translation, quaternion = flange_T_camera.translation, flange_T_camera.rotation.as_quat()
            # a Pose, not a mapping: the calibration is in metres whatever the task's units are
            pose = Pose(translation=tuple(translation.tolist()), quaternion=tuple(quaternion.tolist()))
            return {"mount_covariance": covariance.tolist(), **arm, name: pose}
    return arm


def first_problem(
    error: ValidationError, source: str, document: type[Section], stated: Sequence[int] = ()
) -> str:
    """Return what is wrong first in a file, whose sections are those of ``document``.

    ``stated``: which of the file's obstacles each of ``planning.obstacles`` is of.
    """
    problem = error.errors()[0]
    place = list(problem["loc"])
    if place[:2] == ["planning", "obstacles"] and len(place) > 2:
        place[2] = stated[int(place[2])]
    field = ".".join(map(spelled_name, place)) or document.__name__.lower()
    if problem["type"] == "extra_forbidden":
        legal = fields_at(place[:-1], document)
        given = place[-1]
        return f"{source}: {field}: no such field; legal: {', '.join(legal)}{did_you_mean(given, legal)}"
    given = "" if problem["type"] == "missing" else f"; {spelled(problem['input'])} given"
    more = f" (and {error.error_count() - 1} more)" if error.error_count() > 1 else ""
    said = problem["msg"].removeprefix("Value error, ")  # which is pydantic's, not ours
    return f"{source}: {field}: {said}{given}{more}"
