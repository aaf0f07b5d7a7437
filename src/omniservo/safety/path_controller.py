"""What a controller may do besides: go by the joints' own motion, and slow down on a path."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.servoing import MeasuredPose


@runtime_checkable
class CarriedController(Protocol):
    """A controller that carries what it saw along the joints' own motion."""

    def carried_by(self, where: MeasuredPose) -> None:
        """Take the camera's motion between two times from the joints from now on."""
        ...

    def step(
        self,
        time: float,
        pixels: FloatArray,
        valid: BoolArray,
        acts_at: float | None = None,
        time_sigma: float = 0.0,
    ) -> FloatArray:
        """Return the twist (6,) as `Controller.step`, of an image whose time stamp has a standard deviation.

        ``time_sigma`` in s.
        """
        ...


@runtime_checkable
class PathController(Protocol):
    """A controller with a path, along which it can slow down without images, stand, and go on."""

    def off_path(self, time: float, slowing: float) -> float:
        """Return how far off the path the camera may be once it has slowed down without images [m].

        It moves no farther than the path leads it, wherever to, from where the last image saw it.

        Args:
            time: when it begins to slow down, since the loop's first image [s].
            slowing: how long that takes [s].
        """
        ...

    def distance(self, place: FloatArray) -> float:
        """Return how far a place of the camera is from the path's nearest [m].

        Args:
            place: (3,) [m] in the frame of the camera as it stood at the loop's first image.
        """
        ...

    def slow_down(self, time: float, slowing: float) -> float:
        """Let the reference come to rest on its path; return when it stands.

        Args:
            time: when it begins to slow down, since the loop's first image [s].
            slowing: how long that takes [s].
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
