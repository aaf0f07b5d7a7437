"""A camera on the wall clock whose images carry the time at which they were exposed."""

import time

import numpy as np

from omniservo.robots import CameraImage

BITS, SQUARE = 40, 16


def written(milliseconds, size=(640, 48)):
    """Return an image with a number in it, as squares that are black or white."""
    pixels = np.full((size[1], size[0]), 128, np.uint8)
    for bit in range(BITS):
        column = SQUARE * bit
        pixels[:SQUARE, column : column + SQUARE] = 255 if milliseconds >> bit & 1 else 0
    return pixels


def exposed(pixels):
    """Return the seconds that an image carries, lossy coding or not."""
    squares = (pixels[4:12, SQUARE * bit + 4 : SQUARE * bit + 12].mean() > 128 for bit in range(BITS))
    return sum(1 << bit for bit, on in enumerate(squares) if on) / 1e3


class WallClockCamera:
    """Images at a rate, from `time.monotonic()`; `size` may be set, `silent` too."""

    def __init__(self, rate=50.0, size=(640, 48)):
        self.rate, self.size, self.silent, self.newest = rate, size, False, None

    def image(self):
        now = np.floor(time.monotonic() * self.rate) / self.rate
        if not self.silent and (self.newest is None or now > self.newest.time):
            pixels = written(round(1e3 * now), self.size)
            self.newest = CameraImage(round(1e3 * now) / 1e3, pixels)
        return self.newest

    def close(self):
        pass
