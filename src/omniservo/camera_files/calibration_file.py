"""A calibration file as its reader sees it: fields that are checked, and messages that say where."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from omniservo.camera_files.binary_table import camera_rows
from omniservo.camera_files.document import LENS, FieldPath, parse_fields
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.camera_fields import image_size, numbers
from omniservo.cameras.models.central_model import CentralModel
from omniservo.errors import InputError, spelled, spelled_name
from omniservo.files import as_text, read_bytes
from omniservo.geometry.arrays import finite_number

_MAX_BYTES = 2**20
_LARGEST_SIDE = 1e6
LENS_FIELDS = (
    "max_angle", "dead_zone", "mask", "deviation_px", "model_error", "calibration_covariance",
)  # fmt: skip

_Model = TypeVar("_Model")


@dataclass(frozen=True)
class CalibrationFile:
    """A calibration file's name and fields. A ``path`` of fields goes from the outermost inwards."""

    source: str
    fields: Mapping[str, Any]
    line_of: Callable[[FieldPath], int]
    size: tuple[int, int] | None = None
    """image size that the caller states (width, height) [px]"""
    model: str | None = None
    """camera model that the caller states, for a file that leaves it open"""

    @classmethod
    def read(
        cls, path: str | Path, size: tuple[int, int] | None = None, model: str | None = None
    ) -> CalibrationFile:
        """Read a file of at most 1 MB: JSON, YAML, XML, a table of numbers, or one of the others' own.

        Raises:
            InputError: unreadable, too large, or none of these.
        """
        if size is not None:
            width, height = numbers("size", size, (2,), "(width, height) [px]", _LARGEST_SIDE)
            size = image_size("size", width), image_size("size", height)
        content = read_bytes(path, max_bytes=_MAX_BYTES)
        if b"\0" in content[:8]:  # no text has one, and every cameras.bin begins with a small number
            return cls(str(path), camera_rows(content, str(path)), lambda _: 0, size, model)
        fields, line_of = parse_fields(as_text(content, path), str(path))
        return cls(str(path), fields, line_of, size, model)

    def error(self, problem: str, *path: str | int) -> InputError:
        """Return the error that names file, line (where the field is found) and field."""
        line = self.line_of(path)
        where = f"line {line}: " if line else ""
        return InputError(f"{self.source}: {where}{_joined(path)}: {problem}")

    def value(self, *path: str | int) -> Any:
        """Return a field.

        Raises:
            InputError: it is missing, or what should hold it is not a mapping or list.
        """
        value: Any = self.fields
        for depth, name in enumerate(path):
            if isinstance(name, int):
                if not isinstance(value, list):
                    raise self.error(f"{spelled(value)} given; a list is needed", *path[:depth])
                if name >= len(value):
                    raise self.error("missing", *path[: depth + 1])
            elif not isinstance(value, Mapping):
                raise self.error(f"{spelled(value)} given; a mapping with {name} is needed", *path[:depth])
            elif name not in value:
                raise self.error("missing", *path[: depth + 1])
            value = value[name]
        return value

    def has(self, *path: str | int) -> bool:
        """Say whether a field stands in the file."""
        value: Any = self.fields
        for name in path:
            listed = isinstance(value, list) and isinstance(name, int) and name < len(value)
            if not listed and not (isinstance(value, Mapping) and name in value):
                return False
            value = value[name]
        return True

    def word(self, legal: Iterable[str], *path: str | int) -> str:
        """Return a field that is one of the legal words."""
        value = self.value(*path)
        if not isinstance(value, str) or value not in legal:
            words = ", ".join(repr(word) for word in legal if word)
            raise self.error(f"{spelled(value)} given; legal: {words}", *path)
        return value

    def number(self, *path: str | int, minimum: float = -float("inf"), nonzero: bool = False) -> float:
        """Return a field that is a finite number ≥ ``minimum``, and not 0 where ``nonzero``."""
        return self._number(self.value(*path), path, "", minimum, nonzero)

    def numbers(self, count: int, *path: str | int, nonzero: tuple[int, ...] = ()) -> tuple[float, ...]:
        """Return a field that is a list of ``count`` finite numbers, those at ``nonzero`` not 0."""
        values = self.value(*path)
        if not isinstance(values, list) or len(values) != count:
            raise self.error(f"{spelled(values)} given; a list of {count} numbers is needed", *path)
        return tuple(
            self._number(v, path, f"[{i}]", -float("inf"), i in nonzero) for i, v in enumerate(values)
        )

    def coefficients(self, *path: str | int, legal: tuple[int, ...]) -> tuple[float, ...]:
        """Return a list or one-row or one-column matrix of as many finite numbers as ``legal`` allows."""
        values = self.matrix(*path)
        if len(values) not in legal:
            counts = ", ".join(map(str, legal))
            raise self.error(f"{len(values)} numbers given; legal counts: {counts}", *path)
        return values

    def matrix(self, *path: str | int) -> tuple[float, ...]:
        """Return the numbers, row by row, of a list, of a list of rows, or of {rows, cols, data}.

        OpenCV 5 writes {sizes, data} of what has one dimension, or more than two.

        Raises:
            InputError: another count than rows × cols, or not finite numbers.
        """
        value = self.value(*path)
        if isinstance(value, Mapping):
            sizes = self._sizes(value, *path)
            channels = re.fullmatch(r"(\d{0,3})[a-z]", str(value.get("dt", "d")))
            if channels is None:
                raise self.error(f"{spelled(value['dt'])} given; legal: as in OpenCV, d or 2f", *path, "dt")
            values, path = self.value(*path, "data"), (*path, "data")
            values = [] if values in (None, "") else values if isinstance(values, list) else [values]
            if len(values) != math.prod(sizes) * int(channels[1] or 1):
                needed = " x ".join(f"{size:g}" for size in sizes)
                raise self.error(f"{len(values)} numbers given; {needed} are needed", *path)
        elif isinstance(value, list):
            nested = value and all(isinstance(row, list) for row in value)
            values = [v for row in value for v in row] if nested else value
        else:
            raise self.error(f"{spelled(value)} given; a matrix or list of numbers is needed", *path)
        return tuple(self._number(v, path, f"[{i}]", -float("inf"), False) for i, v in enumerate(values))

    def _sizes(self, matrix: Mapping[str, Any], *path: str | int) -> list[float]:
        """Return how long each dimension of a matrix of OpenCV's is: rows and columns, or its sizes."""
        if "sizes" not in matrix:
            return [self.number(*path, name, minimum=0.0) for name in ("rows", "cols")]
        sizes = matrix["sizes"]
        sizes, path = sizes if isinstance(sizes, list) else [sizes], (*path, "sizes")
        return [self._number(size, path, f"[{i}]", 0.0, False) for i, size in enumerate(sizes)]

    def intrinsics(self, *path: str | int) -> dict[str, float]:
        """Return fx, fy, cx, cy, skew of a field that holds K (3, 3).

        Raises:
            InputError: not 9 numbers, a focal length of 0, or a last row other than 0 0 1.
        """
        values = self.matrix(*path)
        if len(values) != 9:
            raise self.error(f"{len(values)} numbers given; the 9 of K are needed", *path)
        fx, skew, cx, lower, fy, cy, *last = values
        if lower != 0.0 or last != [0.0, 0.0, 1.0]:
            raise self.error("legal: [fx, skew, cx; 0, fy, cy; 0, 0, 1]", *path)
        if fx == 0.0 or fy == 0.0:
            raise self.error("a focal length of 0; legal: any number but 0", *path)
        return {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew}

    def image_size(self, in_file: tuple[float, ...] | None = None, *path: str | int) -> dict[str, int]:
        """Return width and height of the image: the file's (read at ``path``) or, if None, the caller's.

        Raises:
            InputError: neither says them, the two differ, or they are not whole numbers ≥ 1.
        """
        if in_file is None:
            if self.size is None:
                raise InputError(
                    f"{self.source}: the file does not say the image size; say it: --size WIDTHxHEIGHT,"
                    " size=(width, height)"
                )
            return {"width": self.size[0], "height": self.size[1]}
        for number in in_file:
            if number != int(number) or number < 1.0:
                raise self.error(f"{number:g} given; a whole number of pixels is needed, >= 1", *path)
        width, height = map(int, in_file)
        if self.size not in (None, (width, height)):
            given = "x".join(map(str, self.size or ()))
            raise self.error(f"the file's camera has {width}x{height} pixels; {given} was asked for", *path)
        return {"width": width, "height": height}

    def stated_fisheye(self, *path: str | int) -> bool:
        """Return whether the caller states that four numbers of distortion, at ``path``, are a fisheye's.

        Raises:
            InputError: the caller states nothing.
        """
        if self.model is None:
            raise self.error(
                "four numbers may be a pinhole's k1 k2 p1 p2 or a fisheye's k1 k2 k3 k4, and the file does"
                " not say which; say it: --model pinhole or --model fisheye",
                *path,
            )
        return self.model == "fisheye"

    def build(self, make: Callable[..., _Model], *path: str | int, **parameters: Any) -> _Model:
        """Return the model with these parameters and the lens that stands at ``path`` in this file.

        Raises:
            InputError: not a legal model; the message names the file and ``path``.
        """
        holder = self.value(*path) if path else self.fields
        lens = holder.get(LENS, {}) if isinstance(holder, Mapping) else {}
        if not isinstance(lens, Mapping) or set(lens) - set(LENS_FIELDS):
            raise self.error(f"{spelled(lens)} given; legal fields: {', '.join(LENS_FIELDS)}", *path, LENS)
        if "calibration_covariance" in lens and make is not UnifiedCamera:
            raise self.error("calibration_covariance given; legal: of a unified camera only", *path, LENS)
        try:
            return make(**{**parameters, **lens})
        except InputError as error:
            raise InputError(f"{self.source}: {_joined(path) + ': ' if path else ''}{error}") from None

    def _number(self, value: Any, path: FieldPath, index: str, minimum: float, nonzero: bool) -> float:
        try:
            number = finite_number("", value, minimum=minimum)
        except InputError as error:
            raise self.error(index + str(error).removeprefix(": "), *path) from None
        if nonzero and number == 0.0:
            raise self.error(f"{index}0 given; legal: any number but 0", *path)
        return number


def _joined(path: FieldPath) -> str:
    """Return a path as a person writes it: value0.intrinsics[1].fx."""
    joined = "".join(f"[{step}]" if isinstance(step, int) else f".{spelled_name(step)}" for step in path)
    return joined.removeprefix(".")


def lens_fields(model: CentralModel) -> dict[str, Any]:
    """Return the extra field that keeps the lens's limits and the deviation in a foreign file, if any."""
    described = model.to_dict()
    lens = {name: described[name] for name in LENS_FIELDS if described.get(name)}
    return {LENS: lens} if lens else {}


def lens_comment(model: CentralModel) -> str:
    """Return `lens_fields` as the comment line of a table, or nothing."""
    lens = lens_fields(model).get(LENS)
    return f"# {LENS}: {json.dumps(lens)}\n" if lens else ""


def refuse_skew(model: Any, format_name: str) -> None:
    """Refuse a camera with skew for a format that has no place for it.

    Raises:
        InputError: it has skew.
    """
    if getattr(model, "skew", 0.0) != 0.0:
        raise InputError(f"format {format_name!r} cannot hold skew ({model.skew:g}); legal: 'own'")
