"""JSON schema of study files: that of pydantic's sections, with what only a file has."""

from __future__ import annotations

from typing import Any

from omniservo.robots import shipped_arms
from omniservo.run_methods import METHODS
from omniservo.schemas.camera_schema import camera_schema
from omniservo.schemas.result_schemas import UNITS_FIELD
from omniservo.schemas.shapes import (
    NUMBER,
    TEXT,
    Schema,
    choice,
    either,
    mapping,
    of_format,
    said,
    several,
    vector,
)
from omniservo.schemas.task_schema import NAMED_CAMERA, PlainSchema, describe_sections
from omniservo.studies.study import FORMAT, Study
from omniservo.studies.study_arms import NO_ARM
from omniservo.studies.study_folder import FORMAT as RUN

_DISTRIBUTION = said(
    either(
        NUMBER,
        *(mapping({kind: said(vector(2), "[LEAST, MOST]")}) for kind in ("uniform", "log_uniform")),
        mapping({"normal": said(vector(2), "[MEAN, SIGMA]")}),
        mapping({"choice": said(several(NUMBER, 1), "each as likely")}),
    ),
    "one number, or what is drawn anew for each scene",
)


class _StudySchema(PlainSchema):
    """A camera's class is no JSON: what a file has in its place is said afterwards."""

    def is_instance_schema(self, schema: Any) -> Schema:
        """Return a schema that says nothing."""
        return {}


def study_schema() -> Schema:
    """Return the schema of a study's file."""
    schema = Study.model_json_schema(schema_generator=_StudySchema)
    describe_sections(schema, Study)
    parts, fields = schema["$defs"], schema["properties"]
    parts["Distribution"] = _DISTRIBUTION
    parts["camera"] = camera_schema()
    by_name = {"type": "object", "additionalProperties": NAMED_CAMERA, "minProperties": 1}
    fields["cameras"] = said(
        either(several(TEXT, 1), by_name),
        "presets and calibration files, or {NAME: one of them or a camera}",
    )
    fields["methods"]["items"] = choice(*METHODS)
    fields["arms"] = either(choice(NO_ARM, *shipped_arms()), fields["arms"])
    arm = parts["StudyArm"]["properties"]
    arm["foot"] = said({"const": [0, 0, 0]}, "the floor is where the arm's foot is")
    arm["flange_T_camera"] = either(said(TEXT, "the file of a hand-eye calibration"), arm["flange_T_camera"])
    schema["properties"] = {"format": {"const": FORMAT}, "units": UNITS_FIELD, **fields}
    schema["required"] = ["format", *schema["required"]]
    return schema


def study_run_schema() -> Schema:
    """Return the schema of what a study's folder says of its rows, `study.json`."""
    study = study_schema()
    parts = study.pop("$defs")
    study["properties"]["methods"]["items"] = TEXT
    fields: dict[str, Schema] = {
        "study_hash": said({"type": "string", "pattern": "^[0-9a-f]{16}$"}, "of the study"),
        "version": said(TEXT, "of the program"),
        "own_methods": said(several(TEXT), "FILE.CLASS of methods from files, whose code is not kept"),
        "machines": several({"type": "object", "additionalProperties": TEXT}),
        "study": study,
    }
    return {**of_format(RUN, fields), "$defs": parts}
