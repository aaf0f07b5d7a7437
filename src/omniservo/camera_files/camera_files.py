"""Cameras from and to files of every supported format; `docs/how-to-add-a-camera-format.md` adds one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.formats import (
    basalt,
    boofcv,
    camodocal,
    colmap,
    depthai,
    euroc,
    kalibr,
    mei_toolbox,
    metashape,
    mrcal,
    nerfstudio,
    ocamcalib,
    okvis,
    opencv,
    orb_slam,
    ost,
    own,
    py_ocamcalib,
    realsense,
    ros,
    stella_vslam,
    svo,
    visp,
    woodscape,
)
from omniservo.camera_files.usual_error import ErrorLike, with_error
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.camera_fields import largest_angle
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import CentralModel, camera_from_dict
from omniservo.errors import InputError, did_you_mean, spelled
from omniservo.files import write_whole


class _Reader(Protocol):
    """What a format's module offers."""

    def recognises(self, fields: object) -> bool:
        """Say whether a file's fields are of this kind."""

    def names(self, file: CalibrationFile) -> list[str]:
        """Return the names of the file's cameras."""

    def read(self, file: CalibrationFile, name: str) -> CentralModel:
        """Return the camera of this name."""


class _Writer(Protocol):
    """What a format's module offers that can be written, too."""

    def text_of(self, model: CentralModel, suffix: str) -> str:
        """Return the text of a file that holds the camera; ``suffix`` chooses between XML, JSON and YAML."""


@dataclass(frozen=True)
class WrittenFormat:
    """A format that can be written."""

    writer: _Writer
    kinds: tuple[type, ...]
    """the classes that it holds, if not with every number; () is any"""


_READERS: tuple[_Reader, ...] = (
    own,
    opencv,
    kalibr,
    camodocal,
    basalt,
    ros,
    ost,
    ocamcalib,
    svo,
    boofcv,
    colmap,
    mei_toolbox,
    visp,
    stella_vslam,
    orb_slam,
    okvis,
    py_ocamcalib,
    euroc,
    nerfstudio,
    metashape,
    realsense,
    depthai,
    woodscape,
    mrcal,
)

WRITTEN: dict[str, WrittenFormat] = {
    "own": WrittenFormat(own, own.KINDS),
    "mei": WrittenFormat(camodocal, (UnifiedCamera,)),
    "camodocal": WrittenFormat(camodocal, camodocal.KINDS),
    "kalibr": WrittenFormat(kalibr, kalibr.KINDS),
    "opencv": WrittenFormat(opencv, opencv.KINDS),
    "ros": WrittenFormat(ros, ros.KINDS),
    "basalt": WrittenFormat(basalt, basalt.KINDS),
    "ocamcalib": WrittenFormat(ocamcalib, ocamcalib.KINDS),
    "boofcv": WrittenFormat(boofcv, boofcv.KINDS),
    "colmap": WrittenFormat(colmap, colmap.KINDS),
    "visp": WrittenFormat(visp, visp.KINDS),
}

FORMATS: tuple[str, ...] = tuple(WRITTEN)
"""Names that `save_camera` knows."""

_OPEN_MODELS = ("pinhole", "fisheye")


def load_model(
    path: str | Path,
    *,
    name: str | None = None,
    size: tuple[int, int] | None = None,
    model: str | None = None,
    max_angle: float | None = None,
) -> CentralModel:
    """Return the camera of a calibration file as the file has it; its content tells the format.

    Read are our own format and those of other programs; docs/camera.md lists which, and what of each.

    Args:
        path: a file of at most 1 MB. Nothing in it is executed or followed.
        name: which camera of a file with several ("cam1"); a file with one needs none.
        size: (width, height) of the image [px]: needed where the file does not say it, else compared.
        model: "pinhole" or "fisheye", for a file of OpenCV or ost.txt whose four numbers may be either's.
        max_angle: how far from the axis the lens sees [rad], where the file says more or nothing.

    Raises:
        InputError: unreadable, of no known format, or not a legal camera: the message names file, line,
            field, given value and what is legal; or several cameras and no name: it lists the names.
    """
    return read_model(path, name=name, size=size, model=model, max_angle=max_angle)[0]


def read_model(
    path: str | Path,
    *,
    name: str | None = None,
    size: tuple[int, int] | None = None,
    model: str | None = None,
    max_angle: float | None = None,
) -> tuple[CentralModel, CalibrationFile]:
    """Return `load_model` and the file that it was read from."""
    if model is not None and model not in _OPEN_MODELS:
        raise InputError(f"model: {spelled(model)} given; legal: {', '.join(_OPEN_MODELS)}")
    file = CalibrationFile.read(path, size, model)
    reader = next((r for r in _READERS if r.recognises(file.fields)), None)
    if reader is None:
        raise InputError(
            f"{path}: no known camera format; legal: omniservo.camera/1, OpenCV, Kalibr, CamOdoCal / VINS,"
            " Basalt, ROS, OCamCalib, py-OCamCalib, SVO, maplab, BoofCV, COLMAP, Mei (xi), ViSP, ORB-SLAM,"
            " stella_vslam, OKVIS, EuRoC, nerfstudio, Metashape, RealSense, DepthAI, WoodScape, mrcal. Write"
            " others like OpenCV's:"
            ' {"K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "D": […], "image_size": [width, height]}'
        )
    if model is not None and reader not in (opencv, ost):
        raise InputError(f"model: {spelled(model)} given, but {path} says its model itself")
    names = reader.names(file)
    if name is None and len(names) != 1:
        raise InputError(
            f"{path}: {len(names)} cameras; say which: --camera-name NAME, name=; name one of:"
            f" {', '.join(names)[:1000]}"
        )
    if name not in (None, *names):
        raise InputError(
            f"{path}: no camera named {spelled(name)}; legal: {', '.join(names)[:1000] or 'no name'}"
        )
    if name is not None and names.count(name) > 1:
        raise InputError(
            f"{path}: {names.count(name)} cameras named {spelled(name)}; legal: a name of its own each"
        )
    return seen_up_to(reader.read(file, names[0] if name is None else name), max_angle), file


def seen_up_to(camera: CentralModel, max_angle: float | None) -> CentralModel:
    """Return the camera with a lens that sees no farther than ``max_angle`` [rad]; None: as it is."""
    if max_angle is None:
        return camera
    stated = math.pi if camera.max_angle is None else camera.max_angle
    return camera_from_dict(
        {**camera.to_dict(), "max_angle": min(largest_angle(max_angle) or stated, stated)}
    )


def load_camera(
    path: str | Path,
    *,
    name: str | None = None,
    size: tuple[int, int] | None = None,
    model: str | None = None,
    max_angle: float | None = None,
    largest_px: float | None = None,
    camera_error: ErrorLike = None,
) -> UnifiedCamera:
    """Return the camera of a calibration file as a unified camera, converted where it is another model.

    Only plans need one; everything else takes what `load_model` gives as it is.

    It has a model error: ``camera_error`` (σ [px], or a `ModelError`), else what the file says, else what is
    usual (`omniservo.camera_files.usual_error`).

    What the conversion leaves is added to ``deviation_px``, which planning adds to its visibility margin, and
    its rms to the model error; `omniservo.cameras.conversion.to_unified` gives it as a map. ``largest_px``
    [px] refuses what leaves more; None: nothing. The other arguments are those of `load_model`.

    Raises:
        InputError: as `load_model`, or the conversion leaves more than ``largest_px``.
    """
    found, file = read_model(path, name=name, size=size, model=model, max_angle=max_angle)
    return as_unified(with_error(found, camera_error, file), path, largest_px)


def as_unified(camera: CentralModel, source: str | Path, largest_px: float | None = None) -> UnifiedCamera:
    """Return `to_unified` of a camera that ``source`` holds.

    Raises:
        InputError: it leaves more than ``largest_px``.
    """
    try:
        return to_unified(camera, largest_px=largest_px).camera
    except InputError as error:
        raise InputError(f"{source}: {error}") from None


def save_camera(
    camera: CentralModel,
    path: str | Path,
    format: str = "own",  # noqa: A002  the published name
    *,
    force: bool = False,
) -> None:
    """Write a camera so that `load_model` gives an equal one; the file is written whole or not at all.

    Args:
        camera: what to write.
        path: where. ``own``, ``kalibr``, ``ros`` and ``opencv`` are JSON where it ends in .json, else YAML,
            and ``opencv`` is XML where it ends in .xml; every other format has one way to be written.
        format: one of `FORMATS`; ``mei`` is ``camodocal`` with the unified model only. max_angle,
            dead_zone, mask, deviation_px, model_error and calibration_covariance stand where other
            programs ignore them.
        force: replace an existing file.

    Raises:
        InputError: unknown format, a camera that the format cannot hold, or a path that cannot be written.
    """
    write_whole(path, text_in_format(camera, format, Path(path).suffix.lower()), force=force)


def text_in_format(camera: CentralModel, format_name: str, suffix: str = "") -> str:
    """Return the text that `save_camera` writes.

    Raises:
        InputError: unknown format, or a camera that it cannot hold.
    """
    written = WRITTEN.get(format_name)
    if written is None:
        raise InputError(
            f"format: {spelled(format_name)} given; legal: {', '.join(FORMATS)}"
            f"{did_you_mean(format_name, FORMATS)}"
        )
    if written.kinds and not isinstance(camera, written.kinds):
        legal = ", ".join(kind.__name__ for kind in written.kinds)
        raise InputError(f"format {format_name!r} cannot hold a {type(camera).__name__}; legal: {legal}")
    return written.writer.text_of(camera, suffix)
