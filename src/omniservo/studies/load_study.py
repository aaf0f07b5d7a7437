"""Reading study files: the shipped ones by name, the user's by path."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from omniservo.errors import InputError, spelled
from omniservo.files import read_document, stated_units
from omniservo.shipped_studies import study_file
from omniservo.studies.study import FORMAT, MOST_ROWS, Study
from omniservo.tasks.load_task import first_problem, found_camera
from omniservo.tasks.task_files import TaskFiles


def load_study(study: str | Path) -> Study:
    """Read a study: a shipped name or the path of a YAML or JSON file.

    Raises:
        InputError: the file is not a valid study; the message names file, field, value and what is legal.
    """
    path = study_file(study)
    return study_of_fields(read_document(path), TaskFiles(str(study), path.parent))


def study_of_json(text: str) -> Study:
    """Return the study that `Study.to_json` wrote."""
    return study_of_fields(json.loads(text), TaskFiles("study", Path()))


def study_of_fields(document: Any, files: TaskFiles) -> Study:
    """Return the study of a file's fields.

    Raises:
        InputError: a field is missing, unknown or not legal.
    """
    source = files.source
    if not isinstance(document, dict):
        raise InputError(f"{source}: a study is a mapping of fields, not {type(document).__name__}")
    fields = dict(document)
    if fields.pop("format", None) != FORMAT:
        raise InputError(f"{source}: format: {spelled(document.get('format'))} given; legal: {FORMAT!r}")
    for name in ("arm", "arms", "mount"):
        if name in fields:
            raise InputError(f"{source}: {name}: a study moves a free camera; omniservo run has the arm")
    context = stated_units(fields.pop("units", {}), source)
    fields["cameras"] = _found_cameras(fields.get("cameras"), files)
    try:
        found = Study.model_validate(fields, context=context)
    except ValidationError as error:
        raise InputError(first_problem(error, source, Study)) from None
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
