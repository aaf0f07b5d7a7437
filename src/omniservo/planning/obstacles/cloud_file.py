"""Point clouds from files: .npy, .xyz or .txt, .ply. Untrusted: read within bounds, and nothing is run."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omniservo.errors import InputError
from omniservo.files import read_bytes, read_text
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.obstacles.cloud import MOST_CLOUD_POINTS

_PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "<i2", "int16": "<i2",
    "ushort": "<u2", "uint16": "<u2", "int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4",
    "float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8",
}  # fmt: skip


def read_cloud(path: Path) -> FloatArray:
    """Return the points (p, 3) of a file, in its units; they may still be no numbers.

    Raises:
        InputError: not readable, of another kind, larger than 16 MiB or 100 000 points, or broken.
    """
    readers = {".npy": _from_npy, ".xyz": _from_columns, ".txt": _from_columns, ".ply": _from_ply}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path.name}: legal: {', '.join(readers)}")
    return reader(path)


def _from_npy(path: Path) -> FloatArray:
    """Read an array (p, 3) of real numbers, in the version 1 or 2 of NumPy's format."""
    stream = io.BytesIO(read_bytes(path))
    try:
        header = {
            (1, 0): np.lib.format.read_array_header_1_0,
            (2, 0): np.lib.format.read_array_header_2_0,
        }[np.lib.format.read_magic(stream)]
        shape, columnwise, dtype = header(stream)
    except Exception:  # whatever Python's own reader of the header meets: even its tokenizer raises
        raise InputError(f"{path.name}: not an array file (.npy version 1 or 2)") from None
    if dtype.kind not in "fiu" or len(shape) != 2 or shape[1] != 3:
        raise InputError(f"{path.name}: {dtype} of shape {shape} given; real numbers (p, 3) are needed")
    _check_count(path, shape[0])
    data = stream.read()
    if len(data) != shape[0] * 3 * dtype.itemsize:
        raise InputError(f"{path.name}: {len(data)} bytes for {shape[0]} points")
    points: FloatArray = np.frombuffer(data, dtype).reshape(shape, order="F" if columnwise else "C")
    return _as_float64(points)


def _as_float64(numbers: NDArray[Any]) -> FloatArray:
    with np.errstate(all="ignore"):  # NaN and what is too large are told by the caller, in words
        return numbers.astype(np.float64)


def _from_columns(path: Path) -> FloatArray:
    """Read the first three numbers of every line; empty lines and those that begin with # are passed over."""
    rows: list[tuple[int, str]] = []
    for number, line in enumerate(io.StringIO(read_text(path)), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            rows.append((number, line.strip()))
        if len(rows) > MOST_CLOUD_POINTS:
            raise InputError(f"{path.name}: more than {MOST_CLOUD_POINTS} points")
    return _points_of_lines(path, rows)


def _points_of_lines(
    path: Path, rows: list[tuple[int, str]], columns: tuple[int, ...] = (0, 1, 2)
) -> FloatArray:
    _check_count(path, len(rows))
    points = np.empty((len(rows), 3))
    for k, (number, line) in enumerate(rows):
        fields = line.split(maxsplit=max(columns) + 1)
        try:
            points[k] = [float(fields[c]) for c in columns]
        except (IndexError, ValueError):
            raise InputError(f"{path.name}: line {number}: {line:.40} given; x y z are needed") from None
    return points


def _from_ply(path: Path) -> FloatArray:
    """Read x, y, z of the vertices of an ASCII or little-endian file; they must be its first element."""
    data = read_bytes(path)
    text, mark, body = data.partition(b"end_header\n")
    header = [line.split() for line in text.decode("ascii", "replace").splitlines()]
    if not mark or header[:1] != [["ply"]]:
        raise InputError(f"{path.name}: not a PLY file (or its lines do not end with a line feed)")
    kind = next((line[1] for line in header if line[:1] == ["format"] and len(line) == 3), "none")
    if kind not in ("ascii", "binary_little_endian"):
        raise InputError(f"{path.name}: format {kind:.40}; legal: ascii, binary_little_endian")
    count, names = _vertices(path, header)
    if any(axis not in names for axis in "xyz"):
        raise InputError(f"{path.name}: a vertex has no x, y and z")
    if kind == "ascii":
        lines = body.decode("ascii", "replace").splitlines()[:count]
        if len(lines) < count:
            raise InputError(f"{path.name}: ends after {len(lines)} of {count} vertices")
        columns = tuple(list(names).index(axis) for axis in "xyz")
        return _points_of_lines(path, list(enumerate(lines, len(header) + 2)), columns)
    row = np.dtype(list(names.items()))
    if len(body) < count * row.itemsize:
        raise InputError(f"{path.name}: ends after {len(body) // row.itemsize} of {count} vertices")
    vertices = np.frombuffer(body, row, count)
    return np.column_stack([_as_float64(vertices[axis]) for axis in "xyz"])


def _vertices(path: Path, header: list[list[str]]) -> tuple[int, dict[str, str]]:
    """Return how many vertices there are, and the type of every property of one, in the file's order."""
    elements = [i for i, line in enumerate(header) if line[:1] == ["element"]]
    first = header[elements[0]] if elements else []
    if first[1:2] != ["vertex"] or len(first) != 3 or not first[2].isdecimal():
        raise InputError(f"{path.name}: its first element must be its vertices")
    count = int(first[2][:12])
    _check_count(path, count)
    last = elements[1] if len(elements) > 1 else len(header)
    names: dict[str, str] = {}
    for line in header[elements[0] + 1 : last]:
        if line[:1] == ["comment"]:
            continue
        if len(line) != 3 or line[1] not in _PLY_TYPES or line[2] in names:
            raise InputError(f"{path.name}: {' '.join(line):.40}: not a property of a vertex that is read")
        names[line[2]] = _PLY_TYPES[line[1]]
    return count, names


def _check_count(path: Path, count: int) -> None:
    if not 1 <= count <= MOST_CLOUD_POINTS:
        raise InputError(f"{path.name}: {count} points; legal: 1 to {MOST_CLOUD_POINTS}")
