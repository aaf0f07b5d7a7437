"""What was found of a robot, kept beside its file: that it was checked, and how late it is."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass, replace
from pathlib import Path

from omniservo.calibration.camera_delay import SEARCHED
from omniservo.errors import InputError, NoSolutionError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.files import is_file, read_bytes, read_document, write_whole
from omniservo.geometry.arrays import finite_number
from omniservo.runs.loop_delay import LoopDelay
from omniservo.runs.robot_delay import MOST_LAG, RobotDelay
from omniservo.safety import SafetyOptions
from omniservo.tasks import RobotFile

FRESH = 24.0 * 3600.0
"""A check counts for so long [s]."""

SURE = 3.0
"""standard deviations of what was measured that are counted on"""

CHECK, DELAY = "omniservo.robot-check/1", "omniservo.robot-delay/1"


def save_check(path: Path, robot: RobotFile, driver: str | None = None) -> Path:
    """Keep that the robot of this file was found fit, now; return where.

    Args:
        path: of the file.
        robot: as loaded of it.
        driver: replaced the file's.
    """
    beside = path.with_suffix(".check.json")
    fields = {**_devices(robot, driver), "robot_sha256": _hash(robot, driver), "time": time.time()}
    write_whole(beside, json.dumps({"format": CHECK, **fields}, indent=2) + "\n", force=True)
    return beside


def forget_check(path: Path) -> None:
    """Let the check of this file's robot count no more: another one begins, which may find it unfit."""
    path.with_suffix(".check.json").unlink(missing_ok=True)


def forget_delay(path: Path) -> None:
    """Let what was measured of this file's robot count no more: it is measured anew, and may be refused."""
    path.with_suffix(".delay.json").unlink(missing_ok=True)


def require_check(path: Path, robot: RobotFile, driver: str | None = None) -> None:
    """Refuse a robot that was not checked as its files now stand, see `save_check`.

    Raises:
        InputError: no check, an old one, or one of another driver, address, camera or content of the files.
    """
    beside = path.with_suffix(".check.json")
    again = f"run: omniservo robot check {path}"
    if not is_file(beside):
        raise InputError(f"{path}: not checked yet; {again}")
    document = _document(beside, CHECK)
    for name, now in _devices(robot, driver).items():
        if document.get(name) != now:
            was = spelled(document.get(name))
            raise InputError(f"{path}: checked with {name} {was}; it is {spelled(now)} now; {again}")
    if document.get("robot_sha256") != _hash(robot, driver):
        raise InputError(
            f"{path}: changed since it was checked, or a file that it or --driver names; {again}"
        )
    age = time.time() - finite_number(f"{beside}: time", document.get("time"))
    if not 0.0 <= age <= FRESH:
        raise InputError(f"{path}: checked {age / 3600.0:.0f} h ago; at most {FRESH / 3600.0:g} h; {again}")


@with_field_docs
@dataclass(frozen=True)
class StoredDelay:
    """How late a robot's images and motions are, as it was measured."""

    camera_offset: float
    """is added to the stamps of images [s]"""
    camera_sigma: float
    """standard deviation of that [s]"""
    actuation_lag: float
    """joints turn as they were commanded so long before [s]"""
    loop: LoopDelay | None = None
    """from an image's exposure until its twist acts; None: of a file in which its images' age is not"""

    def __post_init__(self) -> None:
        finite_number("camera_offset_s", self.camera_offset, minimum=-SEARCHED, maximum=SEARCHED)
        finite_number("camera_offset_sigma_s", self.camera_sigma, minimum=0.0, maximum=SEARCHED)
        finite_number("actuation_lag_s", self.actuation_lag, minimum=0.0, maximum=MOST_LAG)

    def within(self, options: SafetyOptions) -> SafetyOptions:
        """Return the options of a robot that is so late, whose images are corrected by the offset."""
        return replace(options, command_lag=self.actuation_lag, offset_sigma=self.camera_sigma)


def save_delay(path: Path, robot: RobotFile, found: RobotDelay, driver: str | None = None) -> Path:
    """Keep how late the robot of this file is; return where. See `save_check`.

    Raises:
        NoSolutionError: later than a run bears; nothing is kept.
    """
    beside = path.with_suffix(".delay.json")
    document = {
        "format": DELAY,
        **_devices(robot, driver),
        "camera_offset_s": found.camera.offset,
        "camera_offset_sigma_s": found.camera.sigma,
        "actuation_lag_s": found.actuation_lag,
        "actuation_lag_sigma_s": found.actuation_sigma,
        "image_age_s": found.image_age,
    }
    try:
        _delay_of(document)
    except InputError as error:
        raise NoSolutionError(f"no run can bear that, and it is not kept: {error}") from None
    write_whole(beside, json.dumps(document, indent=2) + "\n", force=True)
    return beside


def stored_delay(path: Path, robot: RobotFile, driver: str | None = None) -> StoredDelay | None:
    """Return how late the robot of this file is, see `save_check`; None where that was not measured.

    Raises:
        InputError: the file beside the robot's is no such record, or of another driver, address or camera.
    """
    beside = path.with_suffix(".delay.json")
    if not is_file(beside):
        return None
    document = _document(beside, DELAY)
    for name, now in _devices(robot, driver).items():
        if document.get(name) != now:
            raise InputError(
                f"{beside}: measured with {name} {spelled(document.get(name))}; it is {spelled(now)} now; "
                f"measure it again: omniservo robot delay {path}"
            )
    try:
        return _delay_of(document)
    except InputError as error:
        raise InputError(f"{beside}: {error}") from None


def _delay_of(document: dict[str, object]) -> StoredDelay:
    """Return what a record states.

    Raises:
        InputError: it is none, or later than a run bears; the message names the field.
    """
    found = StoredDelay(
        finite_number("camera_offset_s", document.get("camera_offset_s")),
        finite_number("camera_offset_sigma_s", document.get("camera_offset_sigma_s")),
        finite_number("actuation_lag_s", document.get("actuation_lag_s")),
    )
    return replace(found, loop=_loop_delay(document))


def _loop_delay(document: dict[str, object]) -> LoopDelay | None:
    """Return how late a twist acts at most, by the record of `save_delay`; None: of an older version."""
    if document.get("image_age_s") is None or document.get("actuation_lag_sigma_s") is None:
        return None
    age, offset, sigma, lag, lag_sigma = (
        finite_number(name, document.get(name))
        for name in (
            "image_age_s", "camera_offset_s", "camera_offset_sigma_s", "actuation_lag_s",
            "actuation_lag_sigma_s",
        )
    )  # fmt: skip
    return LoopDelay(max(age - offset + SURE * sigma, 0.0), lag + SURE * lag_sigma)


def _devices(robot: RobotFile, driver: str | None) -> dict[str, str]:
    own = robot.driver if driver is None else driver
    return {"driver": own, "address": robot.address, "camera_source": robot.camera.source}


def _document(path: Path, wanted: str) -> dict[str, object]:
    document = read_document(path)
    if not isinstance(document, dict) or document.get("format") != wanted:
        raise InputError(f"{path}: format: not what omniservo writes there; legal: {wanted!r}")
    return document


def _hash(robot: RobotFile, driver: str | None) -> str:
    """Return the hash of the robot's file, of those that it names, and of that of a driver of one's own."""
    files = {} if robot.sources is None else dict(robot.sources.kept(robot).files)
    if driver is not None and (own := driver.rpartition(":")[0]).endswith(".py"):
        files[driver] = read_bytes(own)
    found = hashlib.sha256()
    for name in sorted(files):
        found.update(f"{name}\0{len(files[name])}\0".encode() + files[name])
    return found.hexdigest()
