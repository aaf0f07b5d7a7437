"""JSON schemas of tasks, robots and taught goals: those of pydantic's sections, and what only a file has."""

from __future__ import annotations

from typing import Any

from pydantic.json_schema import GenerateJsonSchema

from omniservo.field_docs import _fields_of  # what `help` shows of dataclasses; these are models
from omniservo.schemas.camera_schema import camera_schema
from omniservo.schemas.problem_schema import FILE
from omniservo.schemas.result_schemas import UNITS_FIELD
from omniservo.schemas.shapes import (
    NUMBER,
    TEXT,
    Schema,
    either,
    mapping,
    matrix,
    nullable,
    of_format,
    said,
    several,
)
from omniservo.tasks.robot_file import FORMAT as ROBOT
from omniservo.tasks.robot_file import RobotFile
from omniservo.tasks.section import Section, names_in_file, sections_in
from omniservo.tasks.target import TargetSection
from omniservo.tasks.task import FORMAT as TASK
from omniservo.tasks.task import Task
from omniservo.tasks.taught_goal import FORMAT as GOAL

CAMERA: Schema = {"$ref": "#/$defs/camera"}
NAMED_CAMERA = said(either(TEXT, CAMERA), "a preset's name, a calibration file, or a camera")


class PlainSchema(GenerateJsonSchema):
    """Without titles, which only repeat the fields' names."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        """Return that it should not."""
        return False


def task_schema() -> Schema:
    """Return the schema of a task's file."""
    schema = _file_schema(Task, TASK)
    parts, fields = schema["$defs"], schema["properties"]
    fields["camera"] = NAMED_CAMERA
    parts["SimulationSection"]["properties"]["true_camera"] = nullable(NAMED_CAMERA)
    tube = said(nullable(TEXT), "shipped, or the file of one that was measured")
    parts["Planning"]["properties"]["tracking_tube"] = tube
    for kind, coordinates in (("MeshSection", "vertices"), ("CloudSection", "points")):
        section = parts[kind]
        section["properties"].update(FILE)
        section["required"].remove(coordinates)
        section["oneOf"] = [{"required": [coordinates]}, {"required": ["file"]}]
    parts["Scale"]["oneOf"] = [
        *(_given(name, {"not": {"type": "null"}}) for name in ("displacement", "known_length")),
        *(_given(name, {"const": True}) for name in ("odometry", "tags")),
    ]
    parts["TargetSection"]["oneOf"] = _kinds_of_target()
    joints = said(several(NUMBER, 6, 7), "one number a joint, as the arm's controller reports them")
    fields["start"] = {"oneOf": [{"$ref": "#/$defs/StartSection"}, mapping({"joints": joints})]}
    return schema


def goal_schema() -> Schema:
    """Return the schema of a taught goal."""
    target = TargetSection.model_json_schema(schema_generator=PlainSchema)
    describe_sections(target, TargetSection)
    target["oneOf"] = _kinds_of_target()
    parts = target.pop("$defs")
    png = {**TEXT, "contentEncoding": "base64", "contentMediaType": "image/png"}
    fields = {
        "camera": camera_schema(),
        "image_png": said(png, "grey"),
        "features": said(matrix(None, 2), "[px]"),
        "joints": said(nullable(several(NUMBER)), "of the arm [rad]"),
    }
    taught = {"target": said(nullable(target), "what it was taught of, as in a task")}
    return {**of_format(GOAL, fields, taught), "$defs": parts}


def _kinds_of_target() -> list[Schema]:
    return [
        {**_given("dots", {"minItems": 1}), "required": ["dots", "dot_radius"]},
        *({**_given(name, {}), "not": {"required": ["dot_radius"]}} for name in ("tags", "textures")),
    ]


def _given(name: str, what: Schema) -> Schema:
    return {"required": [name], "properties": {name: what}}


def robot_schema() -> Schema:
    """Return the schema of a robot file."""
    schema = _file_schema(RobotFile, ROBOT)
    schema["$defs"]["RobotCamera"]["properties"]["calibration"] = NAMED_CAMERA
    del schema["$defs"]["ArmMount"]["properties"]["foot"]  # where it stands is said by the task
    return schema


def _file_schema(document: type[Section], format_name: str) -> Schema:
    schema = document.model_json_schema(schema_generator=PlainSchema)
    describe_sections(schema, document)
    schema["properties"] = {"format": {"const": format_name}, "units": UNITS_FIELD, **schema["properties"]}
    schema["required"] = ["format", *schema["required"]]
    schema["$defs"]["camera"] = camera_schema()
    arm = schema["$defs"]["ArmMount"]
    file = said(TEXT, "the file of a hand-eye calibration")
    for name in ("flange_T_camera", "tool_T_camera"):
        arm["properties"][name] = either(file, arm["properties"][name])
    return schema


def describe_sections(schema: Schema, document: type[Section]) -> None:
    """Add to a document's schema what stands in the source, see `_describe`, of it and all its sections."""
    parts = {**schema["$defs"], document.__name__: schema}
    for section in _sections(document):
        _describe(parts[section.__name__], section)


def _describe(schema: Schema, section: type[Section]) -> None:
    """Add what stands under the fields in the source, and the names that they have in older files."""
    words = {name: text for cls in reversed(section.__mro__) for name, text in _fields_of(cls).items()}
    for name, field in section.model_fields.items():
        names = names_in_file(name, field)
        described = schema["properties"].setdefault(names[0], {})
        if name in words and words[name] != str(section.__annotations__.get(name)):
            described["description"] = " ".join(words[name].split())
        for older in names[1:]:
            schema["properties"][older] = {**described, "deprecated": True}
        if len(names) > 1 and names[0] in schema.get("required", ()):
            schema["required"].remove(names[0])
            schema["oneOf"] = [{"required": [one]} for one in names]
        elif len(names) > 1:
            schema["not"] = {"required": names}


def _sections(section: type[Section]) -> set[type[Section]]:
    """Return a section with all that stand inside of it."""
    found, waiting = set(), [section]
    while waiting:
        one = waiting.pop()
        if one not in found:
            found.add(one)
            waiting += [s for field in one.model_fields.values() for s in sections_in(field.annotation)]
    return found
