"""Cameras from and to files of every supported format; `docs/how-to-add-a-camera-format.md` adds one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Protocol

import yaml

from omniservo.calibration import kalibr, mei_yaml, own
from omniservo.calibration.calibration_file import CalibrationFile
from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.files import write_whole


class _CameraFormat(Protocol):
    """What a format's module offers."""

    def recognises(self, fields: Any) -> bool:
        """Say whether a file's fields are of this kind."""
        ...

    def names(self, file: CalibrationFile) -> list[str]:
        """Return the names of the file's cameras."""
        ...

    def read(self, file: CalibrationFile, name: str) -> UnifiedCamera:
        """Return the camera of this name."""
        ...

    def fields_of(self, camera: UnifiedCamera) -> dict[str, Any]:
        """Return the fields of a file that holds the camera."""
        ...


_MODULES: dict[str, _CameraFormat] = {"own": own, "mei": mei_yaml, "kalibr": kalibr}

FORMATS: tuple[str, ...] = tuple(_MODULES)
"""Names that `save_camera` knows."""


def load_camera(path: str | Path, *, name: str | None = None) -> UnifiedCamera:
    """Return the camera of a calibration file; the format is recognised by its content.

    Read are our own format, CamOdoCal / VINS MEI YAML (also inside a larger configuration) and Kalibr
    chains of ``omni-radtan`` cameras.

    Args:
        path: a JSON or YAML file of at most 1 MB. Nothing in it is executed or followed.
        name: which camera of a file with several ("cam1"); a file with one needs none.

    Raises:
        InputError: unreadable, of no known format, or not a legal camera: the message names file, line,
            field, given value and what is legal; or several cameras and no name: it lists the names.
    """
    file = CalibrationFile.read(path)
    module = next((m for m in _MODULES.values() if m.recognises(file.fields)), None)
    if module is None:
        raise InputError(
            f"{path}: no known camera format; legal: a file with format: omniservo.camera/1 (own), with"
            " model_type: MEI (CamOdoCal, VINS), or with cam0, cam1, … of camera_model: omni (Kalibr)"
        )
    names = module.names(file)
    if name is None:
        if len(names) > 1:
            raise InputError(f"{path}: several cameras; name one of: {', '.join(names)}")
        return module.read(file, names[0])
    if name not in names:
        raise InputError(f"{path}: no camera named {name!r}; legal: {', '.join(names) or 'no name'}")
    return module.read(file, name)


def save_camera(camera: UnifiedCamera, path: str | Path, format: str = "own", *, force: bool = False) -> None:  # noqa: A002  the published name
    """Write a camera so that `load_camera` gives an equal one; the file is written whole or not at all.

    Args:
        camera: what to write.
        path: ``own`` is JSON where the path ends in .json, else YAML; the others are YAML.
        format: "own", "mei" or "kalibr". In the last two, max_angle, dead_zone and mask stand in a field
            that other programs ignore.
        force: replace an existing file.

    Raises:
        InputError: unknown format, a camera that the format cannot hold, or a path that cannot be written.
    """
    module = _MODULES.get(format)
    if module is None:
        raise InputError(f"format: {format!r} given; legal: {', '.join(FORMATS)}")
    fields = module.fields_of(camera)
    if module is own and Path(path).suffix.lower() == ".json":
        text = json.dumps(fields, indent=2) + "\n"
    else:
        header = mei_yaml.HEADER if module is mei_yaml else ""
        text = header + yaml.dump(fields, Dumper=_Dumper, sort_keys=False, width=1000)
    write_whole(path, text, force=force)


class _Dumper(yaml.SafeDumper):
    """Lists on one line, as in the originals; OpenCV's reader refuses the other way that YAML has."""


def _list_on_one_line(dumper: yaml.SafeDumper, values: list[Any]) -> yaml.SequenceNode:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_Dumper.add_representer(list, _list_on_one_line)
