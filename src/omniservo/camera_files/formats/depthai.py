"""Calibration JSON of Luxonis's OAK cameras (DepthAI): ``cameraData``, a list of [socket, camera].

cameraType 0 (Perspective) is OpenCV's pinhole with 14 numbers, 1 (Fisheye) Kannala–Brandt with the first
four; intrinsicMatrix is K at width × height, the calibrated resolution. (0, 0) is a pixel's centre. Source:
DepthAI's ``EepromData`` and ``CalibrationHandler``, which writes the file. Read only.
"""

from __future__ import annotations

from typing import Any

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.cameras.models import CentralModel, KannalaBrandt, Pinhole

_KINDS = {0: "perspective", 1: "fisheye", "Perspective": "perspective", "Fisheye": "fisheye"}


def recognises(fields: Any) -> bool:
    """Say whether the fields are a DepthAI calibration."""
    return isinstance(fields.get("cameraData"), list)


def names(file: CalibrationFile) -> list[str]:
    """Return the sockets' numbers, in the file's order."""
    return [str(file.value("cameraData", index, 0)) for index in range(len(file.fields["cameraData"]))]


def read(file: CalibrationFile, name: str) -> CentralModel:
    """Return the camera on this socket.

    Raises:
        InputError: another type of camera, or a field is missing or not legal.
    """
    at = ("cameraData", names(file).index(name), 1)
    stated = file.value(*at, "cameraType")
    kind = _KINDS.get(stated) if isinstance(stated, int | str) else None
    if kind is None:
        raise file.error(f"{stated!r:.40} given; legal: {', '.join(map(str, _KINDS))}", *at, "cameraType")
    given: dict[str, Any] = file.intrinsics(*at, "intrinsicMatrix")
    sides = tuple(file.number(*at, side, minimum=1.0) for side in ("width", "height"))
    given |= file.image_size(sides, *at, "width")
    coefficients = file.coefficients(*at, "distortionCoeff", legal=(0, 4, 5, 8, 12, 14))
    if kind == "fisheye":
        if any(coefficients[4:]):
            problem = f"{len(coefficients)} numbers given; legal: k1 to k4, then zeros"
            raise file.error(problem, *at, "distortionCoeff")
        return file.build(KannalaBrandt, *at, **given, k=coefficients[:4])
    return file.build(Pinhole, *at, **given, distortion=coefficients if any(coefficients) else ())
