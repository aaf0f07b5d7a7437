"""A path in the scene: a tube whose rings are put where the path is."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray, IntArray

Colour = tuple[int, int, int]

PLACES = 25
"""of a path that the tube is put to: one for each ring"""

_SIDES = 6


class PathTube:
    """A tube that is put along one path after the other, in one of a few colours.

    Its rings are the bones of a mesh, and there is a mesh for each colour, of which one is visible: the
    browser moves and shows nodes in the frame in which it takes the message; another line is a frame later.

    Args:
        scene: viser's.
        name: of its nodes.
        radius: [m].
        colours: that it can have (sRGB).
    """

    def __init__(self, scene: Any, name: str, radius: float, colours: tuple[Colour, ...]) -> None:
        vertices, faces = _tube(radius)
        rest = np.tile([1.0, 0.0, 0.0, 0.0], (PLACES, 1))
        self._tubes = {
            colour: scene.add_mesh_skinned(
                f"{name}/{number}", vertices, faces, bone_wxyzs=rest, bone_positions=np.zeros((PLACES, 3)),
                skin_weights=np.repeat(np.eye(PLACES), _SIDES, axis=0), color=colour, side="double",
                cast_shadow=False, receive_shadow=False, visible=False,
            )
            for number, colour in enumerate(colours)
        }  # fmt: skip

    def show(self, places: FloatArray, colour: Colour) -> None:
        """Put it along places (`PLACES`, 3) in the world [m]."""
        quaternions = _turns_along(places).as_quat(scalar_first=True)
        for known, tube in self._tubes.items():
            tube.visible = known == colour
        for bone, place, quaternion in zip(self._tubes[colour].bones, places, quaternions, strict=True):
            bone.position, bone.wxyz = place, quaternion


def _tube(radius: float) -> tuple[FloatArray, IntArray]:
    """Return rings (n, 3) round the z axis, all at the origin, and the sides (m, 3) between neighbours."""
    turn = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    ring = radius * np.stack([np.cos(turn), np.sin(turn), np.zeros(_SIDES)], axis=-1)
    number = np.arange(_SIDES)
    following = (number + 1) % _SIDES
    side = np.concatenate(
        [
            np.stack([number, following, _SIDES + following], axis=-1),
            np.stack([number, _SIDES + following, _SIDES + number], axis=-1),
        ]
    )
    first = _SIDES * np.arange(PLACES - 1)
    return np.tile(ring, (PLACES, 1)), (first[:, None, None] + side).reshape(-1, 3)


def _turns_along(places: FloatArray) -> Rotation:
    """Return for each place (n, 3) a rotation that takes z to the path's direction there."""
    ahead = np.gradient(places, axis=0)
    lengths = np.linalg.norm(ahead, axis=1, keepdims=True)
    ahead = np.where(lengths > 0.0, ahead / np.where(lengths > 0.0, lengths, 1.0), [0.0, 0.0, 1.0])
    aside = np.eye(3)[np.abs(ahead).max(axis=0).argmin()]
    across = np.cross(aside, ahead)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
    return Rotation.from_matrix(np.stack([across, np.cross(ahead, across), ahead], axis=-1))
