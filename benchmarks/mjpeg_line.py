"""How late images are by Motion JPEG over HTTP, from one process to another over the loop-back device.

python -m benchmarks.mjpeg_line [SECONDS]
"""

import multiprocessing
import os
import sys
import time
from urllib.parse import urlsplit

import numpy as np

from omniservo.hardware.camera_sources.mjpeg_reader import MjpegReader
from omniservo.hardware.camera_sources.mjpeg_server import MjpegServer
from omniservo.robots import CameraImage

RATE, SIZES = 30.0, ((640, 480), (1152, 868))


class Scenery:
    """Smooth noise at a rate, exposed when it is asked for."""

    def __init__(self, size: tuple[int, int]) -> None:
        coarse = np.random.default_rng(0).integers(0, 255, (size[1] // 16 + 1, size[0] // 16 + 1))
        self.pixels = np.kron(coarse, np.ones((16, 16)))[: size[1], : size[0]].astype(np.uint8)
        self.newest = CameraImage(-np.inf, self.pixels)

    def image(self) -> CameraImage:
        """See CameraSource."""
        now = time.monotonic()
        if now >= self.newest.time + 1.0 / RATE:
            self.newest = CameraImage(now, self.pixels)
        return self.newest

    def close(self) -> None:
        """See CameraSource."""


def serve(size: tuple[int, int], urls: multiprocessing.SimpleQueue) -> None:
    """Be the camera."""
    urls.put(MjpegServer(Scenery(size)).url)
    time.sleep(1e6)


def measure(size: tuple[int, int], duration: float) -> None:
    """Print the figures of one size."""
    urls: multiprocessing.SimpleQueue = multiprocessing.SimpleQueue()
    process = multiprocessing.Process(target=serve, args=(size, urls), daemon=True)
    process.start()
    reader = MjpegReader(urlsplit(urls.get()), 5.0)
    arrived, read, end = [], [], time.monotonic() + duration
    while time.monotonic() < end:
        frame = reader.read()
        arrived.append(frame.arrival - frame.stamp)
        read.append(time.monotonic() - frame.stamp)
    reader.close()
    process.kill()
    words = f"exposure → arrival {in_words(arrived)}, → decoded {in_words(read)}"
    print(f"{size[0]}×{size[1]}, {len(read)} images: {words}")


def in_words(seconds: list[float]) -> str:
    """Return the median and the 99th percentile."""
    median, high = 1e3 * np.quantile(seconds, [0.5, 0.99])
    return f"{median:.1f} ms (99%: {high:.1f})"


if __name__ == "__main__":
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for size in SIZES:
        measure(size, float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)
