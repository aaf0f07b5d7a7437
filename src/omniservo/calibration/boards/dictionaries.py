"""The marker dictionaries by name, as OpenCV has them."""

from __future__ import annotations

from typing import Any

import cv2

from omniservo.errors import InputError, spelled


def dictionary_names() -> tuple[str, ...]:
    """Return the names of all dictionaries, DICT_4X4_50 and so on."""
    return tuple(sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_")))


def dictionary(name: str) -> Any:
    """Return the ``cv2.aruco.Dictionary`` of this name.

    Raises:
        InputError: no such dictionary.
    """
    if name not in dictionary_names():
        raise InputError(f"dictionary: {spelled(name)} given; legal: {', '.join(dictionary_names())}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
