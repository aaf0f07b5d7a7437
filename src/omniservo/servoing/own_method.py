"""A servo method of the user's own, from a Python file."""

from __future__ import annotations

import inspect
import traceback
from pathlib import Path

import numpy as np

from omniservo.errors import InputError, InvalidData, NotFinite, ServoStop, spelled
from omniservo.files import python_class, stdout_to_stderr
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.servo_measurement import ServoMeasurement
from omniservo.servoing.servo_method import ServoMethod


class OwnMethod:
    """Runs ``CLASS(gain).step(measurement)`` of a file; whatever it raises is a named stop.

    Args:
        source: ``FILE.py:CLASS``, whose code is run.
        gain: λ [1/s].
        code: what the file holds; None: it is read.

    Raises:
        InputError: no such class, or not one that is made from a gain and has ``step``.
    """

    def __init__(self, source: str, gain: float, code: bytes | None = None) -> None:
        made = python_class(source, "method", code)
        try:
            inspect.signature(made).bind(gain)
        except TypeError as error:
            raise InputError(f"method: {source}: {error}; legal: CLASS(gain)") from None
        try:
            with stdout_to_stderr():
                method = made(gain)
        except (Exception, SystemExit) as error:
            raise InputError(f"method: {_said(source, error)}") from error
        if not isinstance(method, ServoMethod) or not callable(method.step):
            raise InputError(f"method: {source} has no step(measurement)")
        self._method, self._source = method, source

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the method's own twist (6,).

        Raises:
            ServoStop: as the method raises it; `NotFinite` where its twist is not six numbers, `InvalidData`
                for anything else.
        """
        try:
            with stdout_to_stderr():
                given = self._method.step(seen)
            twist = np.asarray(given) if np.iterable(given) else np.empty(0)
        except ServoStop:
            raise
        except (Exception, SystemExit) as error:
            raise InvalidData(_said(self._source, error)) from error
        if twist.shape != (6,) or twist.dtype.kind not in "fiu":
            raise NotFinite(
                f"{self._source}: gives the twist {spelled(given)}; six finite numbers are needed"
            )
        return twist.astype(np.float64)


def _said(source: str, error: BaseException) -> str:
    """Return what the user's code raised, and where."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    return f"{source}: {Path(place.filename).name}:{place.lineno}: {type(error).__name__}: {error}"
