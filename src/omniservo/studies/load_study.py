"""Reading study files: the shipped ones by name, the user's by path."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from omniservo.errors import InputError, spelled, spelled_name
from omniservo.files import read_document, stated_units
from omniservo.shipped_studies import study_file
from omniservo.studies.study import FORMAT, MOST_ROWS, Study
from omniservo.studies.study_arms import found_arms
from omniservo.tasks.load_task import first_problem, found_camera
from omniservo.tasks.task_files import TaskFiles


def load_study(study: str | Path, own: Sequence[str] = ()) -> Study:
    """Read a study: a shipped name or the path of a YAML or JSON file.

    Args:
        study: name or path.
        own: names of methods from files (`Program.names`), which are run beside those that the study names.

    Raises:
        InputError: the file is not a valid study; the message names file, field, value and what is legal.
    """
    path = study_file(study)
    document = read_document(path)
    if own and isinstance(document, dict) and isinstance(document.get("methods"), list):
        document = {**document, "methods": [*document["methods"], *own]}
    return study_of_fields(document, TaskFiles(str(study), path.parent), own)


def study_of_json(text: str, own: Sequence[str] = ()) -> Study:
    """Return the study that `Study.to_json` wrote, with methods ``own`` from files."""
    return study_of_fields(json.loads(text), TaskFiles("study", Path()), own)


def study_of_fields(document: Any, files: TaskFiles, own: Sequence[str] = ()) -> Study:
    """Return the study of a file's fields, in which methods ``own`` from files may be named.

    Raises:
        InputError: a field is missing, unknown or not legal.
    """
    source = files.source
    if not isinstance(document, dict):
        raise InputError(f"{source}: a study is a mapping of fields, not {type(document).__name__}")
    fields = dict(document)
    if fields.pop("format", None) != FORMAT:
        raise InputError(f"{source}: format: {spelled(document.get('format'))} given; legal: {FORMAT!r}")
    context: dict[str, Any] = {**stated_units(fields.pop("units", {}), source), "own": own}
    fields["cameras"] = _found_cameras(fields.get("cameras"), files)
    if "arms" in fields:
        fields["arms"] = found_arms(fields["arms"], files)
    try:
        found = Study.model_validate(fields, context=context)
    except ValidationError as error:
        raise InputError(first_problem(error, source, Study)) from None
    for arm in found.arms.mounts.values():
        arm.load()
    for name, camera in found.cameras.items():
        half, margin = 0.5 * min(camera.width, camera.height), found.servo.visibility_margin
        if margin >= half:
            raise InputError(
                f"{source}: servo.visibility_margin: {margin:g} px given; legal: less than {half:g}, "
                f"half the image of {spelled_name(name)}"
            )
    if found.rows > MOST_ROWS:
        raise InputError(
            f"{source}: scenes × cameras × methods: {found.rows} rows; legal: at most {MOST_ROWS}"
        )
    return found


def _found_cameras(given: Any, files: TaskFiles) -> dict[str, Any]:
    """Return cameras by name: a list has presets and files, a mapping gives each its own name."""
    if isinstance(given, list) and given and all(isinstance(name, str) for name in given):
        if len(set(given)) != len(given):
            raise InputError(f"{files.source}: cameras: {spelled(given)}: a camera is given twice")
        given = {name: name for name in given}
    if not isinstance(given, dict) or not given:
        raise InputError(
            f"{files.source}: cameras: {spelled(given)} given; legal: a list of presets and calibration "
            "files, or a mapping {NAME: preset, file or camera}"
        )
    return {str(name): found_camera(f"cameras.{name}", camera, files) for name, camera in given.items()}
