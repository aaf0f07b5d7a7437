"""The camera's sensor and lens: what stands between the light and the grey values."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.errors import InputError
from omniservo.geometry.arrays import finite_number
from omniservo.tasks.sensor import untimely


@dataclass(frozen=True)
class Sensor:
    """How the camera on the flange delivers images.

    Row v of H is exposed for ``exposure`` round the instant (v + ½ − H/2)/H · ``readout`` after the image's
    time stamp, which so is the middle of the whole image's exposure.
    """

    rate: float = 30.0
    """frames per second [Hz]"""
    latency: float = 0.02
    """from the time stamp to delivery [s]"""
    noise: float = 2.0
    """standard deviation of the dark noise, in grey values of 255"""
    blur: float = 0.4
    """standard deviation of the lens's point spread [px]"""
    exposure: float = 0.0
    """of each row [s]; 0: no motion blur"""
    readout: float = 0.0
    """of a rolling shutter: from the first row's instant to that of a row below the last [s]; 0: global"""
    gain: float = 0.0
    """K, grey values per electron: shot noise of a mean grey value g has the variance K g; 0: none"""
    vignetting: float = 0.0
    """share of the light that is lost in the corners, at r from the image's middle (r / corner's r)² of it"""
    defocus: float = 0.0
    """radius of the disc that the lens, out of focus, makes of a point [px]"""
    jpeg: int | None = None
    """quality of the JPEG compression, 1 to 100; None: not compressed"""

    def __post_init__(self) -> None:
        finite_number("sensor: rate", self.rate, above=0.0, maximum=1000.0)
        for name in ("latency", "noise", "blur", "exposure", "readout", "gain", "defocus"):
            finite_number(f"sensor: {name}", getattr(self, name), minimum=0.0)
        finite_number("sensor: vignetting", self.vignetting, minimum=0.0, maximum=1.0)
        if self.jpeg is not None:
            finite_number("sensor: jpeg", self.jpeg, minimum=1, maximum=100)
            if not isinstance(self.jpeg, int):
                raise InputError(f"sensor: jpeg: {self.jpeg} given; a whole number is needed")
        if problem := untimely(self.rate, self.latency, self.exposure, self.readout):
            raise InputError(f"sensor: {problem}")

    @property
    def half_span(self) -> float:
        """Half of the time from the first row's opening to the last row's closing [s]."""
        return 0.5 * (self.exposure + self.readout)
