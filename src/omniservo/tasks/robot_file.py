"""The robot file: which arm and camera a task is done with, and how they are reached."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, ValidationError, field_validator

from omniservo.errors import InputError
from omniservo.files import noting_reads, read_document, require_file, stated_units
from omniservo.robots import Arm, load_arm
from omniservo.tasks.load_task import first_problem, found_arm, found_camera, found_mount
from omniservo.tasks.quantities import Real
from omniservo.tasks.section import Section
from omniservo.tasks.task import ArmMount, WorkspaceSection
from omniservo.tasks.task_files import TaskFiles
from omniservo.tasks.task_sources import TaskSources

FORMAT = "omniservo.robot/1"
"""The format of robot files that this version reads."""

FIRST_SPEED = 0.1
"""share of the joints' speeds where a robot file says nothing"""

_FOLDER = re.compile(r"folder:(?P<path>.+?)(?P<rate>\?rate=.*)?", re.DOTALL)
_NO_PATH = re.compile(r"[a-z0-9]+:.*|\d{1,3}|/dev/.*", re.DOTALL | re.IGNORECASE)
"""cameras that are no folder and no file of a video"""


class RobotCamera(Section):
    """The camera on the arm."""

    source: str
    """URI of its images: v4l2:0, rtsp://…, http://… (MJPEG), folder:…, ros2:/topic"""
    calibration: Any
    """a `CentralModel` once loaded; in the file: a calibration file, a preset's name, or a camera"""
    exposure: Annotated[Real, Field(ge=0, le=1)] = 0.0
    """of each row [s]"""
    readout: Annotated[Real, Field(ge=0, le=1)] = 0.0
    """of a rolling shutter, from the first row to the last [s]"""
    rate: Annotated[Real, Field(gt=0, le=1000)] = 30.0
    """least number of frames per second that is counted on [Hz]"""


class RobotFile(Section):
    """A robot and how it is reached. Build it with `load_robot`."""

    driver: str
    """rtde, ros2, or the name of an installed driver"""
    address: str = ""
    """what the driver connects to: a host of rtde, a DDS domain of ros2"""
    joints: dict[str, str] = Field(default_factory=dict)
    """what the driver calls a joint, by its name in the arm's file; where absent: the same"""
    options: dict[str, bool | int | Real | str] = Field(default_factory=dict)
    """further arguments of the driver"""
    arm: ArmMount
    """as in a task; ``foot`` is the task's"""
    camera: RobotCamera
    watchdog: Annotated[Real, Field(gt=0, le=1)] | None = None
    """The arm is stopped by something of the user's own so long after the last command [s], where the driver
    itself cannot promise that."""
    speed: Annotated[Real, Field(gt=0, le=1)] = FIRST_SPEED
    """share of the joints' speeds that is used"""
    workspace: WorkspaceSection | None = None
    """a box that the camera's centre must not leave, in the arm's base frame"""

    _source: str = PrivateAttr("robot")
    _sources: TaskSources | None = PrivateAttr(None)
    _camera_files: TaskFiles | None = PrivateAttr(None)
    """where a path in ``camera.source`` is; None: in the working folder, as what stands in its place"""

    @property
    def sources(self) -> TaskSources | None:
        """The files that it was read from; None where it was made otherwise."""
        return self._sources

    @property
    def camera_uri(self) -> str:
        """URI of the camera's images; a path in the file is meant from the file's folder.

        Raises:
            InputError: it leaves that folder, and that is not allowed.
        """
        source, files = self.camera.source, self._camera_files
        if files is None:
            return source
        if images := _FOLDER.fullmatch(source):
            return f"folder:{files.path('camera.source', images['path'])}{images['rate'] or ''}"
        return source if _NO_PATH.fullmatch(source) else str(files.path("camera.source", source))

    @field_validator("arm", mode="before")
    @classmethod
    def _no_foot(cls, arm: Any) -> Any:
        if isinstance(arm, dict) and "foot" in arm:
            raise ValueError("arm.foot: where the arm stands in its world is said by the task")
        return arm

    def loaded_arm(self) -> Arm:
        """Return the arm, its joints' speeds reduced to `speed`."""
        arm = load_arm(self.arm.model, flange=self.arm.flange, packages=self.arm.packages)
        for name in self.joints:
            if name not in arm.joint_names:
                legal = ", ".join(arm.joint_names)
                raise InputError(
                    f"{self._source}: joints: {name}: {arm.name} has no such joint; legal: {legal}"
                )
        return arm.slowed(self.speed)

    def driver_names(self, arm: Arm) -> tuple[str, ...]:
        """Return what the driver calls the arm's joints, in the arm's order.

        Raises:
            InputError: two joints have one name.
        """
        names = tuple(self.joints.get(name, name) for name in arm.joint_names)
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise InputError(
                f"{self._source}: joints: {min(twice)}: the name of two; legal: names that differ"
            )
        return names


def load_robot(
    path: str | Path,
    *,
    camera_source: str | None = None,
    speed: float | None = None,
    allow_outside: bool = False,
) -> RobotFile:
    """Read a robot file (YAML), which need not be trusted: it names drivers, and runs no code of its own.

    Args:
        path: of the file.
        camera_source: replaces the file's.
        speed: replaces the file's.
        allow_outside: whether the files that it names may lie outside its folder.

    Raises:
        InputError: not a valid robot file; the message names file, field, value and what is legal.
    """
    with noting_reads() as read:
        robot = _from_file(Path(path), camera_source, speed, allow_outside=allow_outside)
    robot._sources = TaskSources(Path(path).absolute(), read, {})
    return robot


def _from_file(
    path: Path, camera_source: str | None, speed: float | None, *, allow_outside: bool
) -> RobotFile:
    require_file(path)
    files = TaskFiles(str(path), path.parent, allow_outside)
    document, source = read_document(path), files.source
    if not isinstance(document, dict):
        raise InputError(f"{source}: a robot is a mapping of fields, not {type(document).__name__}")
    fields = dict(document)
    if fields.pop("format", None) != FORMAT:
        raise InputError(f"{source}: format: {document.get('format')!r} given; legal: {FORMAT!r}")
    context = stated_units(fields.pop("units", {}), source)
    if isinstance(fields.get("arm"), dict):
        fields["arm"] = found_mount(found_arm(fields["arm"], files, None), files)
    if isinstance(fields.get("camera"), dict):
        camera = dict(fields["camera"])
        camera["calibration"] = found_camera("camera.calibration", camera.get("calibration"), files)
        fields["camera"] = camera if camera_source is None else {**camera, "source": camera_source}
    if speed is not None:
        fields["speed"] = speed
    try:
        robot = RobotFile.model_validate(fields, context=context)
    except ValidationError as error:
        raise InputError(first_problem(error, source, RobotFile)) from None
    robot._source = source
    robot._camera_files = files if camera_source is None else None
    return robot
