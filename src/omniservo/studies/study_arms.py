"""The arms of a study: which of them each scene has, with their files and how the camera sits on them."""

from __future__ import annotations

import base64
import binascii
import json
import os
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator, model_validator

from omniservo.errors import InputError, did_you_mean, spelled
from omniservo.files import noting_reads
from omniservo.robots import Arm, load_arm, shipped_arms, suggested_mount
from omniservo.tasks import KeptTask
from omniservo.tasks.load_task import found_arm, found_mount
from omniservo.tasks.section import Section
from omniservo.tasks.task import ArmMount, Pose
from omniservo.tasks.task_files import TaskFiles

NO_ARM = "none"
"""A camera that moves freely."""

_MOST_BYTES = 8 * 2**20
"""of one arm's files"""
_LONGEST_NAME = 200


def legal_name(name: str) -> None:
    """Refuse the name of a camera or an arm that no table or page could show.

    Raises:
        ValueError: it is empty, too long, or has characters that are not printed.
    """
    if not name.isprintable() or not 1 <= len(name) <= _LONGEST_NAME:
        raise ValueError(f"name {spelled(name)}; legal: 1 to {_LONGEST_NAME} characters that are printed")


class StudyArm(ArmMount):
    """An arm, and how the camera sits on it."""

    files: dict[str, str] = Field(default_factory=dict)
    """of an arm that does not ship with the package: what they hold, by path, in Base64; ``model`` and
    ``packages`` are paths among them. A study's file names the arm's file, and these are filled in"""

    @field_validator("foot")
    @classmethod
    def _on_the_floor(cls, foot: tuple[float, float, float]) -> tuple[float, float, float]:
        if any(foot):
            raise ValueError("a study has no world to stand in: the floor is where the arm's foot is")
        return foot

    def load(self) -> Arm:
        """Return the arm; it is read once in a process.

        Raises:
            InputError: its files are not those of an arm.
        """
        return _loaded(self.model_dump_json(include={"model", "flange", "packages", "files"}))

    @classmethod
    def shipped(cls, name: str) -> StudyArm:
        """Return an arm that ships with the package, with a camera that looks ahead before its flange."""
        mount = suggested_mount(load_arm(name))
        translation, quaternion = mount.translation.tolist(), mount.rotation.as_quat().tolist()
        return cls(model=name, flange_T_camera=Pose(translation=translation, quaternion=quaternion))


class StudyArms(Section):
    """Which arm carries the camera of a scene."""

    choice: Annotated[tuple[str, ...], Field(min_length=1, max_length=100)] = (NO_ARM,)
    """each scene has one of these, each as likely: ``none``, a shipped arm, a name of ``mounts``; a name that
    stands there several times is drawn so much more often"""
    mounts: Annotated[dict[str, StudyArm], Field(max_length=20)] = Field(default_factory=dict)
    """arms by the names that rows have; a shipped one that is named in ``choice`` alone carries the camera
    before its flange"""

    @model_validator(mode="after")
    def _named(self) -> StudyArms:
        for name in self.choice:
            if name != NO_ARM and name not in self.mounts:
                raise ValueError(f"{spelled(name)} is no shipped arm and not in mounts")
        for name in self.mounts:
            legal_name(name)
            if name not in self.choice or name == NO_ARM:
                raise ValueError(f"mounts: {spelled(name)} is not in choice")
        return self

    def draw(self, random: np.random.Generator) -> str:
        """Return the name of one of them."""
        return self.choice[min(int(float(random.random()) * len(self.choice)), len(self.choice) - 1)]


def found_arms(given: Any, files: TaskFiles) -> Any:
    """Return the section ``arms`` of a study's file with its arms read: ``none``, a name, or a mapping.

    Raises:
        InputError: an arm's file is missing, outside the study's folder, too large, or no arm.
    """
    if isinstance(given, str):
        given = {"choice": [given]}
    if not isinstance(given, dict):
        raise InputError(
            f"{files.source}: arms: {spelled(given)} given; legal: none, a shipped arm "
            f"({', '.join(shipped_arms())}), or {{choice: [NAMES], mounts: {{NAME: ARM}}}}"
        )
    mounts, choice = given.get("mounts", {}), given.get("choice", [NO_ARM])
    if not isinstance(mounts, dict) or not isinstance(choice, list | tuple):
        return given  # what is wrong is said with its field
    found = {str(name): _found(f"arms.mounts.{name}", arm, files) for name, arm in mounts.items()}
    legal = (NO_ARM, *found, *shipped_arms())
    for name in dict.fromkeys(name for name in choice if isinstance(name, str)):
        if name not in legal:
            raise InputError(
                f"{files.source}: arms.choice: {spelled(name)} given; legal: {', '.join(legal)}"
                f"{did_you_mean(name, legal)}"
            )
        if name != NO_ARM and name not in found:
            found[name] = StudyArm.shipped(name)
    return {**given, "mounts": found}


def _found(field: str, arm: Any, files: TaskFiles) -> Any:
    """Return the fields of an arm with what its files hold; a study's folder has that already."""
    if not isinstance(arm, dict) or "files" in arm:
        return arm
    own = found_mount(found_arm(arm, files, None), files)
    model = own.get("model", "rx60")
    if not isinstance(model, str) or model in shipped_arms():
        return own
    packages = {name: Path(folder) for name, folder in own.get("packages", {}).items()}
    with noting_reads() as read:
        load_arm(model, flange=own.get("flange"), packages=packages)
    if sum(map(len, read.values())) > _MOST_BYTES:
        raise InputError(f"{files.source}: {field}: more than {_MOST_BYTES} bytes of files; at most so many")
    path = Path(model).absolute()
    root = Path(os.path.commonpath([file.parent for file in (path, *read)] + list(packages.values())))
    return {
        **own,
        "model": path.relative_to(root).as_posix(),
        "packages": {name: folder.relative_to(root).as_posix() for name, folder in packages.items()},
        "files": {
            file.relative_to(root).as_posix(): base64.b64encode(content).decode()
            for file, content in sorted(read.items())
        },
    }


@lru_cache(maxsize=8)
def _loaded(fields: str) -> Arm:
    arm = json.loads(fields)
    if not arm["files"]:
        if arm["model"] not in shipped_arms():
            raise InputError(
                f"arms: model: {spelled(arm['model'])} given; legal: {', '.join(shipped_arms())}"
            )
        return load_arm(arm["model"], flange=arm["flange"])
    try:
        files = {path: base64.b64decode(text, validate=True) for path, text in arm["files"].items()}
    except (binascii.Error, ValueError):
        raise InputError("arms: files: not in Base64") from None
    kept = KeptTask.of_fields("arms", arm["model"], arm["packages"], files)
    with TemporaryDirectory() as folder:
        kept.write(Path(folder))
        packages = {name: Path(folder) / place for name, place in kept.packages.items()}
        return load_arm(Path(folder) / kept.task, flange=arm["flange"], packages=packages)
