"""Boards as people write them: one short text, or Kalibr's target file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from omniservo.calibration.boards.board import AprilGrid, Board, CharucoBoard, Checkerboard, CircleGrid
from omniservo.errors import InputError, spelled, spelled_name
from omniservo.files import parse_document, read_text
from omniservo.geometry.arrays import finite_number
from omniservo.tag_dictionaries import opencv_name

FORMS = {
    "checkerboard": "checkerboard:8x6:0.042 (inner corners, side of a square in m)",
    "charuco": "charuco:8x6:0.04:0.03:DICT_4X4_50 (squares, sides of square and marker in m, dictionary)",
    "aprilgrid": "aprilgrid:6x6:0.088:0.3 (tags, side of a tag in m, gap over side)",
    "circles": "circles:7x5:0.03:0.02 (discs, spacing and diameter in m)",
    "acircles": "acircles:4x11:0.02:0.015 (asymmetric; discs in a row × rows, spacing and diameter in m)",
}
"""how each kind of board is written"""


_LARGEST = 5.0
"""square, marker or tag [m]"""


def board_from_text(text: str) -> Board:
    """Return the board that a text describes; see `FORMS`. A path that ends in .yaml is Kalibr's target file.

    Raises:
        InputError: not such a text; the message names the part that is wrong, and what is legal.
    """
    if not isinstance(text, str):
        raise InputError(f"board: {spelled(text)} given; legal: {'; '.join(FORMS.values())}")
    if text.endswith((".yaml", ".yml")):
        return board_from_kalibr(text)
    kind, *parts = text.strip().split(":")
    if kind not in FORMS:
        raise InputError(f"board: {spelled(text)}: no such kind; legal: {'; '.join(FORMS.values())}")
    count = FORMS[kind].split(" ")[0].count(":")
    if len(parts) != count:
        raise InputError(f"board: {spelled(text)}: {len(parts)} parts after {kind}; legal: {FORMS[kind]}")
    try:
        columns, rows = _size(parts[0])
        return _BUILDERS[kind](columns, rows, parts[1:])
    except InputError as error:
        raise InputError(f"board: {spelled(text)}: {error}; as in {FORMS[kind]}") from None


def _size(part: str) -> tuple[int, int]:
    sides = part.lower().replace("×", "x").split("x")
    if len(sides) != 2 or not all(side.isascii() and side.isdigit() and len(side) <= 4 for side in sides):
        raise InputError(f"size: {spelled(part)} given; legal: columns x rows")
    return int(sides[0]), int(sides[1])


def _number(name: str, part: str) -> float:
    try:
        return finite_number(name, float(part))
    except ValueError:
        raise InputError(f"{name}: {spelled(part)} given; a number is needed") from None


def _length(name: str, part: str) -> float:
    """Return a length [m]; no one holds a board of larger squares before a camera."""
    number = _number(name, part)
    if number > _LARGEST:
        raise InputError(
            f"{name}: {number:g} m given; legal: at most {_LARGEST:g} m; {number:g} mm are {number / 1000:g}"
        )
    return number


def _checkerboard(columns: int, rows: int, parts: Sequence[str]) -> Board:
    return Checkerboard(columns, rows, _length("square", parts[0]))


def _charuco(columns: int, rows: int, parts: Sequence[str]) -> Board:
    return CharucoBoard(
        columns, rows, _length("square", parts[0]), _length("marker", parts[1]), opencv_name(parts[2])
    )


def _aprilgrid(columns: int, rows: int, parts: Sequence[str]) -> Board:
    return AprilGrid(columns, rows, _length("tag size", parts[0]), _number("spacing ratio", parts[1]))


def _circles(columns: int, rows: int, parts: Sequence[str]) -> Board:
    return CircleGrid(columns, rows, _length("spacing", parts[0]), _length("diameter", parts[1]))


def _acircles(columns: int, rows: int, parts: Sequence[str]) -> Board:
    spacing, diameter = _length("spacing", parts[0]), _length("diameter", parts[1])
    return CircleGrid(columns, rows, spacing, diameter, "asymmetric")


_BUILDERS: Mapping[str, Callable[[int, int, Sequence[str]], Board]] = {
    "checkerboard": _checkerboard,
    "charuco": _charuco,
    "aprilgrid": _aprilgrid,
    "circles": _circles,
    "acircles": _acircles,
}

_KALIBR = {
    "checkerboard": ("targetCols", "targetRows", "colSpacingMeters", "rowSpacingMeters"),
    "aprilgrid": ("tagCols", "tagRows", "tagSize", "tagSpacing"),
}


def board_from_kalibr(path: str | Path) -> Board:
    """Return the board of Kalibr's target file (its wiki, *calibration targets*): checkerboard or aprilgrid.

    Raises:
        InputError: unreadable, another kind of target, or a field that is missing or not legal.
    """
    fields = parse_document(read_text(path, max_bytes=2**16), str(path))
    if not isinstance(fields, Mapping) or "target_type" not in fields:
        raise InputError(f"{path}: target_type: missing; a Kalibr target file is needed")
    kind = fields["target_type"]
    if kind not in _KALIBR:
        raise InputError(f"{path}: target_type: {spelled(kind)} given; legal: {', '.join(_KALIBR)}")
    missing = [name for name in _KALIBR[kind] if name not in fields]
    if missing:
        raise InputError(f"{path}: {spelled_name(missing[0])}: missing; needed: {', '.join(_KALIBR[kind])}")
    columns, rows, size, other = (fields[name] for name in _KALIBR[kind])
    try:
        return _of_kalibr(kind, columns, rows, size, other)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _of_kalibr(kind: str, columns: Any, rows: Any, size: Any, other: Any) -> Board:
    if kind == "aprilgrid":
        return AprilGrid(columns, rows, size, other)
    if size != other:
        raise InputError(
            f"rowSpacingMeters: {spelled(other)} given; legal: as colSpacingMeters, {spelled(size)}"
        )
    return Checkerboard(columns, rows, size)
