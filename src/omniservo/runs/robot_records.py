"""What was found of a robot, kept beside its file: that it was checked, and how late it is."""

from __future__ import annotations

import hashlib
import json
import time
from pathlib import Path

from omniservo.errors import InputError
from omniservo.files import is_file, read_document, write_whole
from omniservo.geometry.arrays import finite_number
from omniservo.runs.robot_delay import RobotDelay

FRESH = 24.0 * 3600.0
"""A check counts for so long [s]."""

_CHECK, _DELAY = "omniservo.robot-check/1", "omniservo.robot-delay/1"


def save_check(robot: Path) -> Path:
    """Keep that the robot of this file was found fit, now; return where."""
    path = robot.with_suffix(".check.json")
    document = {"format": _CHECK, "robot_sha256": _hash(robot), "time": time.time()}
    write_whole(path, json.dumps(document, indent=2) + "\n", force=True)
    return path


def require_check(robot: Path) -> None:
    """Refuse a robot that was not checked as its file now stands.

    Raises:
        InputError: no check, an old one, or one of another content of the file.
    """
    path = robot.with_suffix(".check.json")
    again = f"run: omniservo robot check {robot}"
    if not is_file(path):
        raise InputError(f"{robot}: not checked yet; {again}")
    document = _document(path, _CHECK)
    if document.get("robot_sha256") != _hash(robot):
        raise InputError(f"{robot}: changed since it was checked; {again}")
    age = time.time() - finite_number(f"{path}: time", document.get("time"))
    if not 0.0 <= age <= FRESH:
        raise InputError(f"{robot}: checked {age / 3600.0:.0f} h ago; at most {FRESH / 3600.0:g} h; {again}")


def save_delay(robot: Path, found: RobotDelay) -> Path:
    """Keep how late the robot of this file is; return where."""
    path = robot.with_suffix(".delay.json")
    document = {
        "format": _DELAY,
        "camera_offset_s": found.camera.offset,
        "camera_offset_sigma_s": found.camera.sigma,
        "actuation_lag_s": found.actuation_lag,
        "actuation_lag_sigma_s": found.actuation_sigma,
    }
    write_whole(path, json.dumps(document, indent=2) + "\n", force=True)
    return path


def camera_offset(robot: Path) -> float:
    """Return what is added to the camera's stamps of this robot [s]; 0 where it was not measured.

    Raises:
        InputError: the file beside the robot's is no such record.
    """
    path = robot.with_suffix(".delay.json")
    if not is_file(path):
        return 0.0
    return finite_number(f"{path}: camera_offset_s", _document(path, _DELAY).get("camera_offset_s"))


def _document(path: Path, wanted: str) -> dict[str, object]:
    document = read_document(path)
    if not isinstance(document, dict) or document.get("format") != wanted:
        raise InputError(f"{path}: format: not what omniservo writes there; legal: {wanted!r}")
    return document


def _hash(robot: Path) -> str:
    return hashlib.sha256(robot.read_bytes()).hexdigest()
