"""The JSON schema of every file format that omniservo reads or writes, and of every output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from omniservo.errors import InputError, did_you_mean, spelled

_DRAFT = "https://json-schema.org/draft/2020-12/schema"


@dataclass(frozen=True)
class FileFormat:
    """A format, and which function of this room makes its schema."""

    summary: str
    room: str
    function: str
    of: tuple[str, ...] = ()
    """what the function is called with"""

    def schema(self) -> dict[str, Any]:
        """Return the schema without its head; what it is made from is imported now."""
        make: Callable[..., dict[str, Any]] = getattr(
            import_module(f"omniservo.schemas.{self.room}"), self.function
        )
        return make(*self.of)


_OUTPUTS = {
    "run": "run",
    "run-replay": "run --replay RECORDING",
    "run-replay-row": "run --replay STUDY:ROW",
    "study": "study run, study merge",
    "study-share": "study run --shard",
    **{
        command.replace(" ", "-"): command
        for command in (
            "export", "verify", "teach", "view", "examples", "render", "schema", "warm-up", "doctor",
            "camera show", "camera convert", "camera calibrate", "camera rectify", "camera check",
            "robot show", "robot expand", "robot measure-tube", "robot check", "robot delay", "sim serve",
            "study compare",
        )
    },
}  # fmt: skip
"""What prints an output, by the output's name; other commands print what a file's format describes."""


def _output_formats() -> dict[str, FileFormat]:
    found = {}
    for name, command in _OUTPUTS.items():
        full = f"omniservo.{name}-output/1"
        found[full] = FileFormat(f"what {command} --json prints", "output_schemas", "output_schema", (full,))
    return found


FORMATS = {
    "omniservo.problem/1": FileFormat("planning problem", "problem_schema", "problem_schema"),
    "omniservo.obstacles/1": FileFormat(
        "obstacles and margins beside an estimate", "problem_schema", "obstacles_schema"
    ),
    "omniservo.plan/1": FileFormat("plan with its certificate", "problem_schema", "plan_schema"),
    "omniservo.camera/1": FileFormat("camera of any model", "camera_schema", "camera_file_schema"),
    "omniservo.task/1": FileFormat("one whole job", "task_schema", "task_schema"),
    "omniservo.study/1": FileFormat("many closed loops over distributions", "study_schema", "study_schema"),
    "omniservo.study-run/1": FileFormat("what a study's folder holds", "study_schema", "study_run_schema"),
    "omniservo.robot/1": FileFormat("a robot and how it is reached", "task_schema", "robot_schema"),
    "omniservo.target/1": FileFormat("points and tags of known geometry", "result_schemas", "target_schema"),
    "omniservo.goal/2": FileFormat("taught goal", "task_schema", "goal_schema"),
    "omniservo.estimate/1": FileFormat(
        "motion and structure from two images", "result_schemas", "estimate_schema"
    ),
    "omniservo.views/1": FileFormat("the same from several images", "result_schemas", "views_schema"),
    "omniservo.hand_eye/1": FileFormat("hand-eye calibration", "result_schemas", "hand_eye_schema"),
    "omniservo.robot_poses/1": FileFormat(
        "poses of the flange, one an image", "result_schemas", "robot_poses_schema"
    ),
    "omniservo.tracking-tube/2": FileFormat(
        "how far an arm deviates from its paths", "result_schemas", "tracking_tube_schema"
    ),
    "omniservo.run/1": FileFormat("what a run is computed from", "result_schemas", "run_schema"),
    "omniservo.robot-check/1": FileFormat(
        "record that a robot was checked", "result_schemas", "robot_check_schema"
    ),
    "omniservo.robot-delay/1": FileFormat(
        "how late a robot's images are", "result_schemas", "robot_delay_schema"
    ),
    **_output_formats(),
}
"""By the name that stands in the field ``format`` of a file or of a command's output."""


def json_schema(name: str) -> dict[str, Any]:
    """Return the JSON schema (draft 2020-12) of a file format.

    It says what fields a file has, of what kind, in which units. What no schema can say, a reader checks:
    that a quaternion has length 1, that an obstacle's index is one of a task's, and the like.

    Args:
        name: as "plan" or "omniservo.plan/1".

    Raises:
        InputError: no such format.
    """
    known = {short_name(full): full for full in FORMATS}
    full = name if name in FORMATS else known.get(name)
    if full is None:
        raise InputError(
            f"format: {spelled(name)} given; legal: {', '.join(known)}{did_you_mean(name, known)}"
        )
    return {"$schema": _DRAFT, **FORMATS[full].schema(), "title": full}


def short_name(full: str) -> str:
    """Return "plan" of "omniservo.plan/1"."""
    return full.partition(".")[2].partition("/")[0]
