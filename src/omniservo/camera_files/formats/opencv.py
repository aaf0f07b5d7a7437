"""OpenCV's FileStorage in XML, YAML or JSON, and files that people write with its names.

K is a matrix called camera_matrix, cameraMatrix, K or M, the distortion distortion_coefficients, distCoeffs
or D, the size image_width and image_height or image_size; capitals and _ do not matter. Names that end in
1, 2, left or right are several cameras. (0, 0) is a pixel's centre. Source: the samples calibration.cpp,
camera_calibration.cpp, stereo_calib.cpp and omni_calibration.cpp, and the documentation of ``calib3d``,
``fisheye``, ``omnidir``.

The model is detected by
1. ``xi``: omnidir, distortion (k1, k2, p1, p2);
2. what the file says in fisheye_model, distortion_model, camera_model, model or a name with "fisheye" in it;
3. the count: 5, 8, 12 or 14 numbers are the pinhole's, and so is none.

Four numbers alone are (k1, k2, p1, p2) of a pinhole or (k1…k4) of a fisheye: then the caller must say which.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.document import FieldPath
from omniservo.camera_files.formats import ros, svo
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole
from omniservo.errors import InputError

KINDS: tuple[type, ...] = (UnifiedCamera, KannalaBrandt, Pinhole)

STORAGE = "opencv_storage"
"""root of OpenCV's XML"""
_MATRIX = ("cameramatrix", "k", "m", "intrinsicmatrix", "intrinsics", "mtx", "intrinsic")
_DISTORTION = (
    "distortioncoefficients",
    "d",
    "distcoeffs",
    "distortioncoeffs",
    "distcoefs",
    "distcoeff",
    "distcoef",
    "distortion",
    "dist",
)
_MEANT = re.compile("^dist|radial|tangential|coef")
_SINGLE = ("k1", "k2", "k3", "p1", "p2")
"""numbers one by one, which are not read beside K"""
_SAYS = ("distortionmodel", "cameramodel", "model", "modeltype", "cameratype", "projection")
_FISHEYE, _PINHOLE = (
    ("fisheye", "equidistant", "kannala"),
    ("pinhole", "plumb", "radtan", "rational", "brown"),
)
_SUFFIX = re.compile(r"(.*?)(\d|left|right|l|r)?")


def recognises(fields: Any) -> bool:
    """Say whether the fields are an OpenCV storage, or hold a matrix K under one of its names."""
    held = fields.get(STORAGE, fields)
    return STORAGE in fields or (
        bool(_matrices(held)) and not ros.recognises(fields) and not svo.recognises(fields)
    )


def names(file: CalibrationFile) -> list[str]:
    """Return the endings of the names of K ("1", "left"); one camera has camera_name or no name.

    Raises:
        InputError: a storage without K.
    """
    held = file.value(*_root(file))
    found = sorted(_matrices(held)) if isinstance(held, Mapping) else []
    if not found:
        fields = ", ".join(map(str, held))[:200] if isinstance(held, Mapping) else "nothing"
        raise file.error(f"no camera in it: camera_matrix, K or M is needed; found: {fields}", *_root(file))
    return [str(held.get("camera_name", ""))] if found == [""] else found


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera of this name.

    Raises:
        InputError: the model cannot be determined, or a field is missing or not legal.
    """
    root = _root(file)
    held = file.value(*root)
    ending = name if name in _matrices(held) else ""
    given: dict[str, Any] = file.intrinsics(*root, _matrices(held)[ending])
    given |= _size(file, held, root)
    place = _distortion(file, held, root, ending)
    xi = _field(held, ("xi",), ending)
    if xi is not None:
        if file.model is not None:
            raise InputError(f"{file.source}: the file says omnidir (xi); {file.model} was asked for")
        listed = isinstance(held[xi], Mapping | list)
        number = file.coefficients(*root, xi, legal=(1,))[0] if listed else file.number(*root, xi)
        if number < 0.0:
            raise file.error(f"{number:g} given; legal: >= 0", *root, xi)
        four = file.coefficients(*root, place, legal=(0, 4)) if place is not None else ()
        return file.build(UnifiedCamera, *root, **given, xi=number, distortion=four or (0.0,) * 4)
    counts = (0, 4, 5, 8, 12, 14)
    coefficients = file.coefficients(*root, place, legal=counts) if place is not None else ()
    if _is_fisheye(file, held, root, place or _DISTORTION[0], len(coefficients)):
        if place is None:
            raise file.error("missing; a fisheye's k1 k2 k3 k4 are needed", *root, "distortion_coefficients")
        k = file.coefficients(*root, place, legal=(4,))
        return file.build(KannalaBrandt, *root, **given, k=k)
    return file.build(Pinhole, *root, **given, distortion=coefficients)


def text_of(model: CentralModel, suffix: str) -> str:
    """Return the storage's text as `cv2.FileStorage` writes it: XML for .xml, JSON for .json, else YAML."""
    from omniservo.camera_files.formats.opencv_text import storage_text  # OpenCV is loaded for writing only

    return storage_text(model, suffix)


def _root(file: CalibrationFile) -> FieldPath:
    return (STORAGE,) if STORAGE in file.fields else ()


def _plain(name: Any) -> str:
    return str(name).lower().replace("_", "").replace(" ", "")


def _is_matrix(value: Any) -> bool:
    if isinstance(value, Mapping):
        return "data" in value
    return isinstance(value, list) and len(value) in (3, 9)


def _matrices(held: Any) -> dict[str, str]:
    """Return the fields that hold K by the ending of their names."""
    found: dict[str, str] = {}
    if isinstance(held, Mapping):
        for name, value in held.items():
            match = _SUFFIX.fullmatch(_plain(name))
            if match and match[1] in _MATRIX and _is_matrix(value):
                found.setdefault(match[2] or "", str(name))
    return found


def _field(held: Mapping[str, Any], wanted: tuple[str, ...], ending: str = "") -> str | None:
    """Return the field whose plain name is one of the wanted, with the ending."""
    plain = {_plain(name): str(name) for name in reversed(list(held))}
    return next((plain[name + ending] for name in wanted if name + ending in plain), None)


def _distortion(file: CalibrationFile, held: Mapping[str, Any], root: FieldPath, ending: str) -> str | None:
    """Return the field of a camera's distortion.

    Raises:
        InputError: there is none, but one that may be meant for it.
    """
    place = _field(held, _DISTORTION, ending)
    endings = _matrices(held)
    for name, value in held.items() if place is None else ():
        plain = _plain(name)
        meant = _MEANT.search(plain) if isinstance(value, Mapping | list) else plain in _SINGLE
        if plain in _DISTORTION or meant:
            match = _SUFFIX.fullmatch(plain)
            if not (match and match[1] in _DISTORTION and match[2] in endings):
                legal = ", ".join(
                    f"{known}{ending}" for known in ("distortion_coefficients", "distCoeffs", "D")
                )
                raise file.error(f"not known as this camera's distortion; legal: {legal}", *root, name)
    return place


def _size(file: CalibrationFile, held: Mapping[str, Any], root: FieldPath) -> dict[str, int]:
    width, height = _field(held, ("imagewidth", "width")), _field(held, ("imageheight", "height"))
    if width is not None and height is not None:
        sides = tuple(file.number(*root, side, minimum=1.0) for side in (width, height))
        return file.image_size(sides, *root, width)
    size = _field(held, ("imagesize", "size", "resolution", "imgsize"))
    if size is not None:
        return file.image_size(file.coefficients(*root, size, legal=(2,)), *root, size)
    return file.image_size()


def _is_fisheye(
    file: CalibrationFile, held: Mapping[str, Any], root: FieldPath, place: str, count: int
) -> bool:
    """Tell a fisheye's distortion from a pinhole's.

    Raises:
        InputError: neither the caller nor the file says it, and the count does not tell; or they differ.
    """
    told = _told(held)
    if told is None and count != 4 and file.model is None:
        return False
    if told is None:
        return file.stated_fisheye(*root, place)
    if file.model not in (None, told):
        raise InputError(f"{file.source}: the file says {told}; {file.model} was asked for")
    return told == "fisheye"


def _told(held: Mapping[str, Any]) -> str | None:
    """Return pinhole or fisheye where the file says it."""
    for name, value in held.items():
        plain, words = _plain(name), str(value).lower()
        if "fisheye" in plain:
            return "pinhole" if words in ("0", "0.0", "false", "none", "") else "fisheye"
        if plain in _SAYS and any(word in words for word in _FISHEYE):
            return "fisheye"
        if plain in _SAYS and any(word in words for word in _PINHOLE):
            return "pinhole"
    return None
