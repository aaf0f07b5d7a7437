"""What is known of an arm while a servo goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass

from omniservo.geometry.arrays import ByteArray, FloatArray


@dataclass(frozen=True, eq=False)
class Moment:
    """What is known of the arm at one time of the servo."""

    time: float
    """on the clock of the servo [s]"""
    joints: FloatArray
    """(n,) [rad]"""
    words: str
    """what it does: the supervisor's state, or what a run says of itself"""
    w: float = math.nan
    """path parameter; NaN: not known"""
    image: ByteArray | None = None
    """(rows, columns) the camera's; None: it is to be rendered"""
