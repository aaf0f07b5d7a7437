"""The part of a catadioptric image that shows the camera itself."""

from dataclasses import dataclass

from omniservo.geometry.arrays import finite_number


@dataclass(frozen=True)
class DeadZone:
    """A disc in the image that shows nothing of the scene."""

    center: tuple[float, float]
    """(u, v) [px]"""
    radius: float
    """[px], > 0"""

    def __post_init__(self) -> None:
        center = tuple(finite_number("dead_zone.center", c) for c in self.center)
        object.__setattr__(self, "center", center)
        object.__setattr__(self, "radius", finite_number("dead_zone.radius", self.radius, above=0.0))
