"""What a file says of an arm, in words that refer to no other file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from omniservo.geometry.arrays import FloatArray

LEGAL_COUNTS = (6, 7)
"""Joints that an arm may have."""


ENDLESS = 2.0 * math.pi
"""[rad] range to both sides of a joint without limits: a camera's cable does not turn endlessly"""


@dataclass(frozen=True)
class Description:
    """An arm as MuJoCo reads it: every mesh that the text names is among the assets."""

    xml: str
    """MJCF or URDF"""
    assets: dict[str, bytes]
    """meshes as STL, by the names that the text calls them"""
    speed: tuple[float, ...] | None
    """[rad/s] from the base outwards; None: not stated"""
    acceleration: tuple[float, ...] | None
    """[rad/s²] from the base outwards; None: not stated"""
    notices: tuple[str, ...]
    """what of the file was left out or put in"""
    vertices: Mapping[str, FloatArray]
    """(n, 3) of each mesh by the name of its asset, or its own where it has no file: as they are stated"""
    hand: frozenset[str] = frozenset()
    """links behind joints that are held still"""


def held_notice(joints: Sequence[str]) -> str:
    """Say which joints are not the arm's."""
    return f"joints that are not the arm's, held still with what they carry: {', '.join(joints)}"


def endless_notice(joints: Sequence[str]) -> str:
    """Say which joints have no limits."""
    turns = f"{math.degrees(ENDLESS):.0f}"
    return f"continuous joints, taken as -{turns} … {turns} deg: {', '.join(joints)}"
