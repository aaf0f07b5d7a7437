"""The file of a task or a robot, and all that it names, kept as they were read: to be loaded elsewhere."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, spelled
from omniservo.files import noting_reads, write_whole
from omniservo.robots import load_arm, shipped_arms

if TYPE_CHECKING:
    from omniservo.tasks.robot_file import RobotFile
    from omniservo.tasks.task import Task

_PACKAGE = Path(__file__).parents[1]

MOST_FILES = 2000
"""So many files may belong to a task."""


@dataclass(frozen=True)
class TaskSources:
    """What a task or a robot was read from. Any two are equal: they are what they say, not where it stood."""

    path: Path = field(compare=False)
    """of the file"""
    read: Mapping[Path, bytes] = field(compare=False)
    """what was read for it, by absolute paths"""
    packages: Mapping[str, str | Path] = field(compare=False)
    """folders of ROS packages by name, as given beside the task"""

    def kept_robot(self) -> KeptRobot | None:
        """Return the robot on which the task is done; None: that of the task."""
        return None

    def kept(self, whose: Task | RobotFile) -> KeptTask:
        """Return all of it with the arm's files, by paths from the folder that all of them lie in."""
        read, arm = dict(self.read), whose.arm
        if arm.model not in shipped_arms():
            with noting_reads() as of_arm:
                load_arm(arm.model, flange=arm.flange, packages=arm.packages)
            read |= of_arm
        own = self.path.absolute()
        given = {name: Path(folder).absolute() for name, folder in self.packages.items()}
        files = {file: data for file, data in read.items() if file == own or _PACKAGE not in file.parents}
        folders = [file.parent for file in files] + list(given.values())
        root = Path(os.path.commonpath(folders))
        return KeptTask(
            own.relative_to(root).as_posix(),
            {name: folder.relative_to(root).as_posix() for name, folder in given.items()},
            {file.relative_to(root).as_posix(): data for file, data in files.items()},
        )


@dataclass(frozen=True)
class TaskOnRobot(TaskSources):
    """What a task was read from that is done on a real robot."""

    task: Task = field(compare=False)
    """as it was read"""
    robot: RobotFile = field(compare=False)
    """the robot"""
    late: Mapping[str, float] | None = field(default=None, compare=False)
    """how late its images and motions were taken to be [s]; None: as the robot file states"""

    def kept(self, whose: Task | RobotFile) -> KeptTask:
        """Return the task's files, as it was read, and not as it is done on the robot."""
        return super().kept(self.task)

    def kept_robot(self) -> KeptRobot | None:
        """Return the robot with its files; None where it was not read from a file."""
        sources = self.robot.sources
        return None if sources is None else KeptRobot(sources.kept(self.robot), self.robot.speed, self.late)


@dataclass(frozen=True)
class KeptRobot:
    """A robot file with its files, which need not be trusted."""

    files: KeptTask
    """the robot file's path in the place of the task's"""
    speed: float
    """share of the joints' speeds that was used"""
    late: Mapping[str, float] | None = None
    """how late its images and motions were taken to be [s]; None: as the robot file states"""

    def load(self, folder: Path, *, allow_outside: bool = False) -> RobotFile:
        """Return the robot from the folder that ``files`` were written to.

        Raises:
            InputError: as `load_robot`.
        """
        from omniservo.tasks.robot_file import load_robot

        return load_robot(folder / self.files.task, speed=self.speed, allow_outside=allow_outside)


@dataclass(frozen=True)
class KeptTask:
    """A task, or a robot file, with its files, which need not be trusted."""

    task: str
    """the path of the task's file"""
    packages: Mapping[str, str]
    """folders of ROS packages by name"""
    files: Mapping[str, bytes]
    """by path, / between folders"""

    @classmethod
    def of_fields(cls, source: str, task: Any, packages: Any, files: Mapping[str, bytes]) -> KeptTask:
        """Return it from fields of a document.

        Raises:
            InputError: another type, or a path that leads out of the folder.
        """
        if not isinstance(task, str) or task not in files:
            raise InputError(f"{source}: task: {spelled(task)} given; legal: one of the files kept with it")
        if not isinstance(packages, dict) or not all(isinstance(v, str) for v in packages.values()):
            raise InputError(f"{source}: packages: {spelled(packages)} given; legal: {{NAME: FOLDER, …}}")
        if len(files) > MOST_FILES:
            raise InputError(f"{source}: {len(files)} files; at most {MOST_FILES} belong to a task")
        for path in [*files, *packages.values()]:
            _refuse_outside(source, path)
        return cls(task, packages, files)

    def write(self, folder: Path) -> None:
        """Put the files into a folder, which exists."""
        for name, data in self.files.items():
            _refuse_outside(str(folder), name)
            file = folder / name
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise InputError(f"{spelled(name)}: {error.strerror or error}") from None
            write_whole(file, data)

    def load(self, folder: Path, camera: CentralModel, *, allow_outside: bool = False) -> Task:
        """Return the task from the folder that `write` put it into, with this camera.

        Raises:
            InputError: as `load_task`.
        """
        from omniservo.tasks.load_task import load_task

        packages = {name: folder / place for name, place in self.packages.items()}
        return load_task(folder / self.task, camera=camera, packages=packages, allow_outside=allow_outside)


def _refuse_outside(source: str, path: str) -> None:
    parts = PurePosixPath(path).parts
    if path.startswith("/") or ".." in parts or "\0" in path or "\\" in path or len(path) > 1000:
        raise InputError(f"{source}: the path {spelled(path)} given; legal: one that stays inside")
