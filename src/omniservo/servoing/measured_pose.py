"""Where the joints have the camera."""

from typing import Protocol

from omniservo.geometry.arrays import FloatArray


class MeasuredPose(Protocol):
    """Where the joints have the camera: as measured, and after the last reading as what was sent leads on."""

    def __call__(self, time: float, /) -> FloatArray:
        """Return base_T_camera at ``time`` since the loop's first image [s].

        Quaternion (x, y, z, w) and translation [m], (7,).
        """
        ...

    @property
    def until(self) -> float:
        """Until when what the camera does is known: nothing that is sent later acts before [s]."""
        ...
