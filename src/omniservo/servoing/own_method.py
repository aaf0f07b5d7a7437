"""A servo method of the user's own, from a Python file."""

from __future__ import annotations

import inspect
import traceback
from pathlib import Path

from omniservo.errors import InputError, InvalidData, ServoStop
from omniservo.files import python_class
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.servo_measurement import ServoMeasurement
from omniservo.servoing.servo_method import ServoMethod


class OwnMethod:
    """Runs ``CLASS(gain).step(measurement)`` of a file; whatever the step raises is a named stop.

    Args:
        source: ``FILE.py:CLASS``, whose code is run.
        gain: λ [1/s].
        code: what the file holds; None: it is read.

    Raises:
        InputError: no such class, or not one that can be made from a gain and has ``step``.
    """

    def __init__(self, source: str, gain: float, code: bytes | None = None) -> None:
        made = python_class(source, "method", code)
        try:
            inspect.signature(made).bind(gain)
        except TypeError as error:
            raise InputError(f"method: {source}: {error}; legal: CLASS(gain)") from None
        try:
            method = made(gain)
        except _RAISED as error:
            raise InputError(f"method: {source}: {_in_words(error)}") from error
        if not isinstance(method, ServoMethod):
            raise InputError(f"method: {source} has no step(measurement)")
        self._method, self._source = method, source

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the method's own twist (6,).

        Raises:
            ServoStop: as the method raises it; `InvalidData` for anything else.
        """
        try:
            return self._method.step(seen)
        except ServoStop:
            raise
        except _RAISED as error:
            raise InvalidData(f"{self._source}: {_in_words(error)}") from error


_RAISED = (Exception, SystemExit)
"""by a user's own code; Ctrl-C is not its own"""


def _in_words(error: BaseException) -> str:
    """Return where something was raised, and what."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{Path(place.filename).name}:{place.lineno}: {type(error).__name__}: {error}"
