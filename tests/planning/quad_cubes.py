"""OBJ files of cubes whose faces have four corners, as Blender writes them."""

from itertools import product

import numpy as np

CORNERS = np.array(list(product((0.0, 1.0), repeat=3)))
QUADS = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))


def quad_cubes(*places, corner="{0}"):
    """The file's text.

    ``corner``: a corner by the vertex's number, {0}, or as it is counted back from the last one, {1}.
    """
    text = ["vt 0 0", "vn 0 0 1"]
    for k, place in enumerate(places):
        text += [f"v {x} {y} {z}" for x, y, z in CORNERS + place]
        for quad in QUADS:
            text.append(f"f {' '.join(corner.format(8 * k + i, i - 9) for i in quad)}  # a face")
    return "\r\n".join(text)
