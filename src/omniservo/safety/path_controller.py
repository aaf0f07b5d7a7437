"""What a controller may know besides: where joints have the camera, and a path on which it can slow down."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeAlias, runtime_checkable

from omniservo.geometry.arrays import FloatArray

Where: TypeAlias = Callable[[float], FloatArray]
"""From the time since the loop's first image [s] to base_T_camera by the joints: quaternion (x, y, z, w) and
translation [m], (7,). As measured; beyond the last reading as what was sent leads on"""


@runtime_checkable
class CarriedController(Protocol):
    """A controller that carries what it saw along the joints' own motion."""

    def carried_by(self, where: Where) -> None:
        """Take the camera's motion between two times from the joints from now on."""
        ...


@runtime_checkable
class PathController(Protocol):
    """A controller with a path, along which it can slow down without images, stand, and go on."""

    def slow_down(self, time: float, least: float, most: float, room: float) -> float:
        """Let the reference slow down on its path from ``time`` on; return when it stands [s].

        Args:
            time: since the loop's first image [s].
            least: the shortest that slowing down may take [s].
            most: the longest, where it is longer than ``least`` [s].
            room: the camera should not get farther than this from where the path had it at the last image,
                the distance to the path that was seen there taken off [m]; ``least`` goes before it.
        """
        ...

    def coast(self, time: float, acts_at: float) -> FloatArray:
        """Return the twist (6,) for the camera where the joints have it, in place of an image.

        Args:
            time: of this instant, since the loop's first image [s].
            acts_at: when the twist will act, likewise.

        Raises:
            ServoStop: there is no twist to stand for.
        """
        ...

    def go_on(self, time: float, rising: float) -> None:
        """Let the reference go on from ``time`` [s], within ``rising`` [s] as fast as planned."""
        ...
