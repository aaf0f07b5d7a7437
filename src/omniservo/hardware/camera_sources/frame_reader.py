"""What one opened camera, stream or file gives, frame by frame."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple, Protocol

from omniservo.geometry.arrays import ByteArray


class StampClock(Enum):
    """Which clock a reader's time stamps are of."""

    OWN = "own"
    """`time.monotonic()` of this machine"""
    SENDER = "sender"
    """another one, whose offset and drift are not known"""


class Frame(NamedTuple):
    """One frame, as it came."""

    pixels: ByteArray
    """(height, width) grey values"""
    stamp: float | None
    """on the reader's clock [s]; None: it carries none"""
    arrival: float
    """when it was here, by `time.monotonic()` [s]"""


class FrameLoss(Exception):
    """The source gives no more frames now; it may when it is opened again."""


class EndOfFrames(Exception):
    """A file or folder has no more frames."""


class UnlikeFrame(Exception):
    """A frame has another size or another form than those before."""


class FrameReader(Protocol):
    """Reads frames, waiting for each. One thread reads; another may call `hang_up`."""

    clock: StampClock
    """of the frames' stamps"""
    is_live: bool
    """whether frames are made when they are exposed, so that old ones may wait in buffers"""

    def read(self) -> Frame:
        """Wait for the next frame.

        Raises:
            FrameLoss: the source is gone, or too long silent.
            EndOfFrames: there are no more.
            UnlikeFrame: what came has another size or form.
        """
        ...

    def hang_up(self) -> None:
        """Let a `read` that waits raise FrameLoss soon."""
        ...

    def close(self) -> None:
        """Let go of the source."""
        ...
