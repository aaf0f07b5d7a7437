"""COLMAP's cameras.bin as the rows that its cameras.txt has."""

from __future__ import annotations

import struct
from typing import Any

from omniservo.errors import InputError

_HEAD, _CAMERA = struct.Struct("<Q"), struct.Struct("<IiQQ")
_MODELS = {
    0: ("SIMPLE_PINHOLE", 3),
    1: ("PINHOLE", 4),
    2: ("SIMPLE_RADIAL", 4),
    3: ("RADIAL", 5),
    4: ("OPENCV", 8),
    5: ("OPENCV_FISHEYE", 8),
    6: ("FULL_OPENCV", 12),
    7: ("FOV", 5),
    8: ("SIMPLE_RADIAL_FISHEYE", 4),
    9: ("RADIAL_FISHEYE", 5),
    10: ("THIN_PRISM_FISHEYE", 12),
    11: ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    12: ("SIMPLE_DIVISION", 4),
    13: ("DIVISION", 5),
    14: ("SIMPLE_FISHEYE", 3),
    15: ("FISHEYE", 4),
    16: ("EUCM", 6),
    17: ("EQUIRECTANGULAR", 2),
}
"""name and count of parameters by COLMAP's number of the model, as of version 4.2: its ``sensor/models.h``"""


def camera_rows(data: bytes, source: str) -> dict[str, Any]:
    """Return ``{"rows": [[id, MODEL, width, height, parameters…], …]}`` of a cameras.bin.

    The file has a count (64 bits), then for each camera id, model (32 bits each), width, height (64 bits
    each) and the parameters as doubles, all little-endian.

    Raises:
        InputError: it is none.
    """
    rows: list[list[Any]] = []
    try:
        (count,), at = _HEAD.unpack_from(data), _HEAD.size
        while len(rows) < count:
            number, model, width, height = _CAMERA.unpack_from(data, at)
            kind, parameters = _MODELS[model]
            at += _CAMERA.size
            rows.append([number, kind, width, height, *struct.unpack_from(f"<{parameters}d", data, at)])
            at += 8 * parameters
    except (struct.error, KeyError):
        at = -1
    if at != len(data) or not rows:
        raise InputError(f"{source}: neither text (UTF-8) nor a cameras.bin of COLMAP")
    return {"rows": rows}
