"""What a run is computed from, as a document beside its results and in its recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import omniservo
from omniservo.errors import InputError, spelled
from omniservo.files import read_bytes, read_document, write_whole
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.run_methods import METHODS
from omniservo.runs.loop_delay import LoopDelay
from omniservo.tasks import KeptRobot, KeptTask

FORMAT = "omniservo.run/1"
"""The format of the document."""

FILES = "files"
"""The folder of the task's files."""

_FOLDER = "inputs"
_DOCUMENT = "run.json"


@dataclass(frozen=True, eq=False)
class RunInputs:
    """A job with its parameters."""

    version: str
    """of the program that did it"""
    method: str
    """its name"""
    seed: int
    """of everything random"""
    task: KeptTask
    """with its files"""
    start_joints: FloatArray | None = None
    """(n,) where the scene has the arm at first [rad]; None: where the task says"""

    robot: KeptRobot | None = None
    """that it was done on; None: the task's"""

    @classmethod
    def now(
        cls,
        method: str,
        seed: int,
        task: KeptTask,
        start_joints: FloatArray | None = None,
        robot: KeptRobot | None = None,
    ) -> RunInputs:
        """Return the inputs of a run of this version."""
        return cls(omniservo.__version__, method, seed, task, start_joints, robot)

    def to_json(self) -> str:
        """Return the document; the files are kept beside it."""
        return json.dumps(
            {
                "format": FORMAT,
                "version": self.version,
                "method": self.method,
                "seed": self.seed,
                "task": self.task.task,
                "packages": dict(self.task.packages),
                "start_joints": None if self.start_joints is None else self.start_joints.tolist(),
                "robot": None
                if self.robot is None
                else {
                    "file": self.robot.files.task,
                    "speed": self.robot.speed,
                    "late": None if self.robot.late is None else dict(self.robot.late),
                },
            }
        )

    @classmethod
    def from_fields(
        cls,
        fields: Any,
        files: Mapping[str, bytes],
        place: str,
        robot_files: Mapping[str, bytes] = MappingProxyType({}),
    ) -> RunInputs:
        """Return it from the fields of a document, which need not be trusted; ``place`` names it.

        ``files`` are the task's, ``robot_files`` those of the robot file.

        Raises:
            InputError: a field that is not legal.
        """
        if not isinstance(fields, dict) or fields.get("format") != FORMAT:
            raise InputError(f"{place}: format: legal: {FORMAT!r}")
        method, seed = fields.get("method"), fields.get("seed")
        if not isinstance(method, str) or method not in METHODS:
            raise InputError(f"{place}: method: {spelled(method)} given; legal: {', '.join(METHODS)}")
        if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
            raise InputError(f"{place}: seed: {spelled(seed)} given; legal: a whole number from 0")
        start = fields.get("start_joints")
        return cls(
            str(fields.get("version"))[:40],
            method,
            seed,
            KeptTask.of_fields(place, fields.get("task"), fields.get("packages"), files),
            None if start is None else finite_array(f"{place}: start_joints", start, (None,)),
            _robot(fields.get("robot"), robot_files, f"{place}: robot"),
        )

    def write(self, run: Path) -> None:
        """Put it into the folder of a run."""
        folder = run / _FOLDER
        (folder / FILES).mkdir(parents=True)
        write_whole(folder / _DOCUMENT, self.to_json())
        self.task.write(folder / FILES)

    @classmethod
    def read(cls, run: Path) -> RunInputs:
        """Return what `write` put there.

        Raises:
            InputError: it is not there, or not legal.
        """
        folder = run / _FOLDER
        if not (folder / _DOCUMENT).is_file():
            raise InputError(
                f"{run}: no {_FOLDER}/{_DOCUMENT}: not a folder of omniservo run, or one of a real robot, "
                "which no simulator repeats"
            )
        kept = folder / FILES
        files = {
            file.relative_to(kept).as_posix(): read_bytes(file, max_bytes=2**28)
            for file in sorted(kept.rglob("*"))
            if file.is_file()
        }
        return cls.from_fields(read_document(folder / _DOCUMENT), files, str(folder / _DOCUMENT))


def _robot(fields: Any, files: Mapping[str, bytes], place: str) -> KeptRobot | None:
    if fields is None:
        return None
    if not isinstance(fields, dict):
        raise InputError(f"{place}: {spelled(fields)} given; legal: {{file: PATH, speed: NUMBER}}")
    speed = finite_number(f"{place}: speed", fields.get("speed"), above=0.0, maximum=1.0)
    late = LoopDelay.from_fields(fields.get("late"), f"{place}: late")
    kept = KeptTask.of_fields(place, fields.get("file"), {}, files)
    return KeptRobot(kept, speed, None if late is None else late.to_dict())
