"""What of a task only the simulator knows: whoever estimates, plans and controls sees its images alone."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, field_validator

from omniservo.tasks.quantities import A_NUMBER, Direction, Real
from omniservo.tasks.section import Section


class LightSection(Section):
    """Light from all sides, and from a far lamp; without shadows."""

    brightness: Annotated[Real, Field(ge=0, le=4)] = 1.0
    """of both; what would be brighter than white is white"""
    ambient: Annotated[Real, Field(ge=0, le=1)] = 0.68
    """share that comes from all sides"""
    direction: Direction = (-0.55, 0.25, 0.80)
    """towards the lamp, in the world"""


class LightChange(LightSection):
    """Light that shines from some time on."""

    time: Annotated[Real, Field(ge=0, le=3600)]
    """since the camera is switched on at the start [s]"""


class LensErrorSection(Section):
    """A smooth displacement of the image that no model has: a sample of a Gaussian process."""

    sigma: Annotated[Real, Field(ge=0, le=10)]
    """standard deviation in u and in v [px]"""
    length: Annotated[Real, Field(gt=0, le=2)] = 0.2
    """over which it is alike: ℓ of the covariance σ² exp(−r²/2ℓ²), as a share of the image's width"""
    seed: Annotated[int, Field(ge=0), A_NUMBER] = 0
    """of the sample"""


class SimulationSection(Section):
    """What the simulator alone is given."""

    true_camera: Any = None
    """the camera whose images are taken, where it is not the one that the program is given: any model; in
    the file as ``camera``. Its image has the same size"""
    lens_error: LensErrorSection | None = None
    """on top of that"""
    light: LightSection = LightSection()
    """at the start"""
    goal_light: LightSection | None = None
    """when the goal is taught; where absent: `light`"""
    light_changes: tuple[LightChange, ...] = ()
    """on the way, in the order of their times"""

    @field_validator("light_changes")
    @classmethod
    def _in_order(cls, changes: tuple[LightChange, ...]) -> tuple[LightChange, ...]:
        times = [change.time for change in changes]
        if times != sorted(times):
            raise ValueError("the times must not fall")
        return changes
