"""The part of a catadioptric image that shows the camera itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import finite_number

LARGEST_PX = 1e9
"""Coordinates and lengths in an image are at most this [px]."""


@with_field_docs
@dataclass(frozen=True)
class DeadZone:
    """An open disc in the image that shows nothing of the scene.

    Raises:
        InputError: a number is not finite, or the radius is not positive.
    """

    center: tuple[float, float]
    """(u, v) [px]"""
    radius: float
    """[px], > 0"""

    def __post_init__(self) -> None:
        center = self.center
        is_list = hasattr(center, "__len__") and not isinstance(center, str | bytes | Mapping | Set)
        if not is_list or len(center) != 2:
            raise InputError(f"dead_zone.center: {spelled(center)} given; legal: two numbers [u, v]")
        numbers = tuple(
            finite_number("dead_zone.center", c, minimum=-LARGEST_PX, maximum=LARGEST_PX) for c in center
        )
        object.__setattr__(self, "center", numbers)
        object.__setattr__(
            self, "radius", finite_number("dead_zone.radius", self.radius, above=0.0, maximum=LARGEST_PX)
        )


DeadZoneLike = DeadZone | Mapping[str, Any] | Sequence[Any] | None
"""What a camera accepts: a `DeadZone`, ``{"center": [u, v], "radius": px}``, ``((u, v), px)`` or None."""


def dead_zone_from(value: DeadZoneLike) -> DeadZone | None:
    """Return the dead zone that ``value`` spells.

    Raises:
        InputError: another kind of value, an unknown field, or numbers that are no disc.
    """
    if value is None or isinstance(value, DeadZone):
        return value
    if isinstance(value, Mapping):
        if set(value) != {"center", "radius"}:
            raise InputError(
                f"dead_zone: fields {spelled(sorted(map(str, value)))} given; legal: center, radius"
            )
        return DeadZone(value["center"], value["radius"])
    if isinstance(value, Sequence) and not isinstance(value, str | bytes) and len(value) == 2:
        return DeadZone(value[0], value[1])
    raise InputError(f'dead_zone: {spelled(value)} given; legal: null or {{"center": [u, v], "radius": px}}')
