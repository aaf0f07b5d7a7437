"""OBJ documents: the triangles of their faces.

trimesh 5.2 counts corners with negative numbers from the last vertex of the file, and leaves faces of four
corners as they are.
"""

from __future__ import annotations

from array import array

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray

_MOST_TRIANGLES = 2_000_000


def obj_triangles(text: str) -> tuple[FloatArray, IntArray]:
    """Return vertices (v, 3) and triangles (f, 3) of all faces of a document, in its order.

    Faces of more corners are cut as fans. A corner with a negative number is counted back from the last
    vertex before its face. Materials, lines, curves, normals and names are not read.

    Raises:
        ValueError: a vertex of fewer than three numbers, a face of fewer than three corners, what should be a
            number and is none, or too many triangles.
    """
    vertices, corners = array("d"), array("q")
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").splitlines():
        kind, *words = line.partition("#")[0].split() or [""]
        if kind == "v":
            x, y, z = map(float, words[:3])
            vertices.extend((x, y, z))
        elif kind == "f":
            first, second, *others = (_row(word, len(vertices) // 3) for word in words)
            if not others:
                raise ValueError("a face of fewer than 3 corners")
            for third in others:
                corners.extend((first, second, third))
                second = third
            if len(corners) > 3 * _MOST_TRIANGLES:
                raise ValueError(f"more than {_MOST_TRIANGLES} triangles")
    return np.array(vertices).reshape(-1, 3), np.array(corners, dtype=np.int64).reshape(-1, 3)


def _row(word: str, count: int) -> int:
    """Return the row of the vertex that a corner names, where so many vertices are known."""
    number = int(word.partition("/")[0])
    if number == 0:
        raise ValueError("a corner of number 0")
    return number - 1 if number > 0 else count + number
