"""A task's tags and textured faces as printed panels."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray, frozen
from omniservo.perception import tag_cells, tag_picture
from omniservo.scenes.panel import Panel
from omniservo.scenes.textures import texture
from omniservo.tasks.target import MOST_FACES, TagSection, TargetSection, TexturedFace

BLACK, WHITE = 0.03, 0.88
"""Linear grey of ink and paper."""

ELEMENTS = 1024
"""Of a textured face's longer side."""

_SHORTEST = 16  # elements


def panels_of_target(target: TargetSection, world_T_initial: RigidTransform) -> tuple[Panel, ...]:
    """Return the panels that show a target's tags or textured faces; none for dots.

    Args:
        target: in the initial camera frame.
        world_T_initial: that frame in the world.
    """
    tags = () if target.tags is None else target.tags.panels
    dictionary = "" if target.tags is None else target.tags.dictionary
    return (
        *(_tag(tag, dictionary, world_T_initial) for tag in tags),
        *(_face(f"face {i}", face, world_T_initial) for i, face in enumerate(target.textures)),
    )


def _tag(tag: TagSection, dictionary: str, world_T_initial: RigidTransform) -> Panel:
    """A whole print."""
    cells = tag_picture(dictionary, tag.id, pixels_per_cell=1)
    picture = np.where(cells > 0, WHITE, BLACK)
    side = tag.edge * len(cells) / tag_cells(dictionary)
    return Panel(f"tag {tag.id}", world_T_initial * tag.transform, np.array([side, side]), picture)


def _face(name: str, face: TexturedFace, world_T_initial: RigidTransform) -> Panel:
    """A textured face with square image elements, or nearly."""
    width, height = face.size
    shape = np.maximum(np.rint(ELEMENTS * np.array([height, width]) / max(face.size)), _SHORTEST).astype(int)
    picture = _texture(face.kind, face.seed, int(shape[0]), int(shape[1]))
    return Panel(name, world_T_initial * face.transform, np.array(face.size), picture)


@lru_cache(maxsize=MOST_FACES)
def _texture(kind: str, seed: int, rows: int, columns: int) -> FloatArray:
    """Made once: a run builds its scene several times."""
    return frozen(texture(kind, seed, rows, columns))
