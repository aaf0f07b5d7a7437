"""The dictionaries of square tags by name: AprilTag families and ArUco dictionaries, as OpenCV has them."""

from __future__ import annotations

from typing import Any

import cv2

from omniservo.errors import InputError, spelled

_PREFIXES = (("DICT_APRILTAG_", "tag"), ("DICT_", ""))


def dictionary_names() -> tuple[str, ...]:
    """Return the names of all dictionaries: 4x4_50 … 7x7_1000, aruco_original, tag16h5 … tag36h11."""
    return tuple(sorted(map(_short, _opencv_names())))


def opencv_name(name: str) -> str:
    """Return OpenCV's name, as DICT_4X4_50, of a dictionary given by this name or its short one, in any case.

    Raises:
        InputError: no such dictionary.
    """
    wanted = name.lower() if isinstance(name, str) else ""
    for known in _opencv_names():
        if wanted in (known.lower(), _short(known)):
            return known
    raise InputError(f"dictionary: {spelled(name)} given; legal: {', '.join(dictionary_names())}")


def dictionary(name: str) -> Any:
    """Return the ``cv2.aruco.Dictionary`` of this name; see `opencv_name`."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(name)))


def dictionary_size(name: str) -> int:
    """Return how many tags a dictionary has: ids are 0 … this − 1."""
    return len(dictionary(name).bytesList)


def _opencv_names() -> tuple[str, ...]:
    return tuple(name for name in dir(cv2.aruco) if name.startswith("DICT_"))


def _short(name: str) -> str:
    prefix, short = next(pair for pair in _PREFIXES if name.startswith(pair[0]))
    return short + name.removeprefix(prefix).lower()
