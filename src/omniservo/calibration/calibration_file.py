"""A calibration file as its reader sees it: fields that are checked, and messages that say where."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.files import parse_document, read_text
from omniservo.geometry.arrays import finite_number

_MAX_BYTES = 2**20
_LENS = "omniservo_lens"
"""where our largest angle, dead zone and mask stand in a foreign file, whose own readers ignore the field"""

_LENS_FIELDS = ("max_angle", "dead_zone", "mask", "deviation_px")


@dataclass(frozen=True)
class CalibrationFile:
    """A calibration file's name, text and fields. A ``path`` of fields goes from the outermost inwards."""

    source: str
    text: str
    fields: Mapping[str, Any]

    @classmethod
    def read(cls, path: str | Path) -> CalibrationFile:
        """Read a JSON or YAML file of at most 1 MB, also as OpenCV's FileStorage writes it.

        Raises:
            InputError: unreadable, too large, not JSON or YAML, or not a mapping of fields.
        """
        text = read_text(path, max_bytes=_MAX_BYTES)
        plain = re.sub(r"^%YAML.*$", "", text, count=1, flags=re.MULTILINE).replace("!!opencv-matrix", "")
        fields = parse_document(plain, str(path))
        if not isinstance(fields, Mapping):
            raise InputError(f"{path}: {type(fields).__name__} found; a calibration is a mapping of fields")
        return cls(str(path), text, fields)

    def error(self, problem: str, *path: str) -> InputError:
        """Return the error that names file, line (where the field is found) and field."""
        line = self._line(path)
        where = f"line {line}: " if line else ""
        return InputError(f"{self.source}: {where}{'.'.join(path)}: {problem}")

    def value(self, *path: str) -> Any:
        """Return a field.

        Raises:
            InputError: it is missing, or what should hold it is not a mapping.
        """
        value: Any = self.fields
        for depth, name in enumerate(path):
            if not isinstance(value, Mapping):
                raise self.error(f"{value!r} given; a mapping with {name} is needed", *path[:depth])
            if name not in value:
                raise self.error("missing", *path[: depth + 1])
            value = value[name]
        return value

    def number(self, *path: str, minimum: float = -float("inf"), nonzero: bool = False) -> float:
        """Return a field that is a finite number ≥ ``minimum``, and not 0 where ``nonzero``."""
        return self._number(self.value(*path), path, "", minimum, nonzero)

    def numbers(self, count: int, *path: str, nonzero: tuple[int, ...] = ()) -> tuple[float, ...]:
        """Return a field that is a list of ``count`` finite numbers, those at ``nonzero`` not 0."""
        values = self.value(*path)
        if not isinstance(values, list) or len(values) != count:
            raise self.error(f"{values!r} given; a list of {count} numbers is needed", *path)
        return tuple(
            self._number(v, path, f"[{i}]", -float("inf"), i in nonzero) for i, v in enumerate(values)
        )

    def camera(self, *path: str, **parameters: Any) -> UnifiedCamera:
        """Return the camera with these parameters and the lens that stands at ``path`` in this file."""
        holder = self.value(*path) if path else self.fields
        lens = holder.get(_LENS, {})
        if not isinstance(lens, Mapping) or set(lens) - set(_LENS_FIELDS):
            raise self.error(f"{lens!r} given; legal fields: {', '.join(_LENS_FIELDS)}", *path, _LENS)
        try:
            return UnifiedCamera(**parameters, **lens)
        except InputError as error:
            raise InputError(f"{self.source}: {'.'.join(path) + ': ' if path else ''}{error}") from None

    def _number(self, value: Any, path: tuple[str, ...], index: str, minimum: float, nonzero: bool) -> float:
        try:
            number = finite_number("", value, minimum=minimum)
        except InputError as error:
            raise self.error(index + str(error).removeprefix(": "), *path) from None
        if nonzero and number == 0.0:
            raise self.error(f"{index}0 given; legal: any number but 0", *path)
        return number

    def _line(self, path: tuple[str, ...]) -> int:
        """Return the line on which the field stands, 0 where it is not found."""
        position = 0
        for name in path:
            found = re.compile(rf"""(?:^|[\s{{,])["']?{re.escape(name)}["']?\s*:""", re.MULTILINE).search(
                self.text, position
            )
            if found is None:
                return 0
            position = found.end() - 1
        return self.text.count("\n", 0, position) + 1


def foreign_fields(camera: UnifiedCamera, format_name: str) -> dict[str, Any]:
    """Return the extra field that keeps the lens's angle, dead zone and mask in a foreign file, if any.

    Raises:
        InputError: the camera has skew, which no foreign format holds.
    """
    if camera.skew != 0.0:
        raise InputError(f"format {format_name!r} cannot hold skew ({camera.skew:g}); legal: 'own'")
    described = camera.to_dict()
    lens = {name: described[name] for name in _LENS_FIELDS if described.get(name) is not None}
    return {_LENS: lens} if lens else {}
