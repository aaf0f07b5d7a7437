"""How a task's camera delivers images."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from omniservo.tasks.quantities import A_NUMBER, Real
from omniservo.tasks.section import Section


class SensorSection(Section):
    """How the camera delivers images; an image's time stamp is the middle of its exposure."""

    rate: Annotated[Real, Field(gt=0, le=1000)] = 30.0
    """frames per second [Hz]"""
    latency: Annotated[Real, Field(ge=0, le=1)] = 0.02
    """from the time stamp to delivery [s]"""
    noise: Annotated[Real, Field(ge=0, le=50)] = 2.0
    """standard deviation of the dark noise, in grey values of 255"""
    blur: Annotated[Real, Field(ge=0, le=5)] = 0.4
    """standard deviation of the lens's point spread [px]"""
    exposure: Annotated[Real, Field(ge=0, le=1)] = 0.0
    """of each row [s]: motion blur; the arm moves so slowly that it is borne"""
    readout: Annotated[Real, Field(ge=0, le=1)] = 0.0
    """of a rolling shutter, from the first row to the last [s]; 0: a global shutter"""
    gain: Annotated[Real, Field(ge=0, le=10)] = 0.0
    """grey values per electron: shot noise of a grey value g has the variance gain · g"""
    vignetting: Annotated[Real, Field(ge=0, lt=1)] = 0.0
    """share of the light that is lost in the image's corners, less inwards with the square of the radius"""
    defocus: Annotated[Real, Field(ge=0, le=20)] = 0.0
    """radius of the disc that a point becomes [px]"""
    jpeg: Annotated[int, Field(ge=1, le=100), A_NUMBER] | None = None
    """quality of the JPEG compression; where absent the image is not compressed"""

    @model_validator(mode="after")
    def _timely(self) -> SensorSection:
        if problem := untimely(self.rate, self.latency, self.exposure, self.readout):
            raise ValueError(problem)
        return self


def untimely(rate: float, latency: float, exposure: float, readout: float) -> str:
    """Return what is wrong where an image cannot be exposed and read in its time; else nothing."""
    for name, value in (("exposure", exposure), ("readout", readout)):
        if value > 1.0 / rate:
            return f"{name}: {value:g} s given; legal: 0 to a frame's period, {1.0 / rate:.4g} s"
    if 0.5 * (exposure + readout) > latency:
        return (
            f"latency: {latency:g} s given; legal: half of exposure and readout, "
            f"{0.5 * (exposure + readout):g} s, or more"
        )
    return ""
