"""Where the codes of the AprilTag 3 families come from: AprilRobotics' library, of the wheel ``pyapriltags``.

Run: ``python -m benchmarks.april_tag_codes``, where that wheel is installed (the group ``bench`` has it). It
writes ``april_tags.npz`` beside ``tag_dictionaries.py`` anew, or says that nothing would change. A code in
the library is a whole number, and of each bit it has the cell in which it stands.
"""

from __future__ import annotations

import ctypes
import io
import itertools
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from omniservo.geometry.arrays import IntArray
from omniservo.tag_dictionaries import APRIL_TAGS_3, CODE_STEP, CODES_FILE


class Family(NamedTuple):
    """A family as the library has it."""

    codes: list[int]
    bits: int
    places: IntArray
    """(bits, 2) x and y of the cells, from that of the square's top left one, from the highest bit on"""
    border: int
    """cells along the side of the square"""
    cells: int
    """along the side of the whole print"""


class _Struct(ctypes.Structure):
    """``apriltag_family_t`` of the library."""

    _fields_ = (
        ("ncodes", ctypes.c_uint32),
        ("codes", ctypes.POINTER(ctypes.c_uint64)),
        ("width_at_border", ctypes.c_int),
        ("total_width", ctypes.c_int),
        ("reversed_border", ctypes.c_bool),
        ("nbits", ctypes.c_uint32),
        ("bit_x", ctypes.POINTER(ctypes.c_int32)),
        ("bit_y", ctypes.POINTER(ctypes.c_int32)),
    )


def library() -> Any | None:
    """Return the library of the wheel, None where that is not installed."""
    spec = find_spec("pyapriltags")
    files = (
        []
        if spec is None
        else [
            p
            for p in Path(spec.origin or "").parent.glob("*apriltag.*")
            if p.suffix in (".so", ".dll", ".dylib")
        ]
    )
    return ctypes.CDLL(str(files[0])) if files else None


def family_of(known: Any, name: str) -> Family:
    """Return a family of the library."""
    create = getattr(known, f"{name}_create")
    create.restype = ctypes.POINTER(_Struct)
    read = create().contents
    places = np.array([read.bit_x[: read.nbits], read.bit_y[: read.nbits]]).T
    return Family(read.codes[: read.ncodes], read.nbits, places, read.width_at_border, read.total_width)


def steps(family: Family) -> list[int]:
    """Return how many steps of the generator each code comes after the one before it."""
    size = 2**family.bits
    back = pow(CODE_STEP, -1, size)
    count = [(code - family.codes[0]) * back % size for code in family.codes]
    return [0, *(b - a for a, b in itertools.pairwise(count))]


def main() -> None:
    """Write the file."""
    known = library()
    if known is None:
        sys.exit("pyapriltags is not installed: pip install pyapriltags")
    arrays = {}
    for name in APRIL_TAGS_3:
        family = family_of(known, name)
        offset = (family.cells - family.border) // 2
        many = np.array(steps(family))
        arrays[f"{name}_steps"] = many.astype(np.uint32) if many.max() < 2**32 else many
        arrays[f"{name}_places"] = (family.places + offset).astype(np.uint8)
        arrays[f"{name}_numbers"] = np.array([family.border, family.cells, family.codes[0]])
    written = io.BytesIO()
    np.savez_compressed(written, allow_pickle=False, **arrays)
    if CODES_FILE.exists() and CODES_FILE.read_bytes() == written.getvalue():
        print(f"{CODES_FILE.name} is as it should be")
        return
    CODES_FILE.write_bytes(written.getvalue())
    print(f"{CODES_FILE.name} written, {len(written.getvalue())} bytes")


if __name__ == "__main__":
    main()
