"""How long a 1 MP image takes from one process to another by ROS 2 messages, and what the codec takes of it.

Run: ``python -m benchmarks.ros2_images [--jpeg]``. A process sends 1024 × 1024 mono8 images with its
`time.monotonic()` as stamp, 30 and 60 a second; this one takes each as `Ros2Camera` does. On loopback.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

import numpy as np

from omniservo.hardware.ros2.image_pixels import grey_of_compressed, grey_of_image
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.node import RosNode
from omniservo.ros_messages.cdr import decode, encode
from omniservo.ros_messages.messages import CompressedImageMessage, HeaderMessage, ImageMessage, TimeMessage

DOMAIN = 231
SIDE = 1024


def made(jpeg: bool) -> ImageMessage | CompressedImageMessage:
    """Return an image with texture, raw or as JPEG."""
    import cv2

    noise = np.random.default_rng(0).integers(0, 255, (SIDE, SIDE), dtype=np.uint8)
    pixels = cv2.GaussianBlur(noise, (0, 0), 3.0)
    if jpeg:
        return CompressedImageMessage(format="jpeg", data=cv2.imencode(".jpg", pixels)[1].reshape(-1))
    return ImageMessage(HeaderMessage(), SIDE, SIDE, "mono8", 0, SIDE, pixels.reshape(-1))


def send(rate: float, count: int, jpeg: bool) -> None:
    """Send images once there is who takes them."""
    node, message = RosNode(DdsNetwork.localhost(DOMAIN)), made(jpeg)
    publisher = node.publish("/image", type(message), reliable=False)
    while not publisher.matched:
        time.sleep(0.01)
    time.sleep(0.5)
    begin = time.monotonic()
    for k in range(count):
        time.sleep(max(begin + k / rate - time.monotonic(), 0.0))
        message.header.stamp = TimeMessage.of(time.monotonic())
        publisher.write(message)
    time.sleep(0.5)
    node.close()


def received(rate: float, count: int, jpeg: bool) -> np.ndarray:
    """Return the ages of the images at their arrival, as grey values [s]."""
    node = RosNode(DdsNetwork.localhost(DOMAIN))
    heard = node.subscribe("/image", CompressedImageMessage if jpeg else ImageMessage, depth=4)
    call = [sys.executable, "-m", "benchmarks.ros2_images", "send", str(rate), str(count), str(jpeg)]
    with subprocess.Popen(call) as sender:
        ages = []
        while sender.poll() is None:
            heard.wait(0.1)
            for message in heard.take():
                _ = (
                    grey_of_compressed(message)
                    if isinstance(message, CompressedImageMessage)
                    else grey_of_image(message)
                )
                ages.append(time.monotonic() - message.header.stamp.seconds)
    node.close()
    return np.array(ages)


def median_ms(work) -> float:  # noqa: ANN001
    """Return how long a call takes, in the median of 100 [ms]."""
    taken = []
    for _ in range(100):
        before = time.perf_counter()
        work()
        taken.append(time.perf_counter() - before)
    return 1e3 * float(np.median(taken))


def main() -> None:
    """Print codec times, then ages of images for two rates."""
    if sys.argv[1:2] == ["send"]:
        send(float(sys.argv[2]), int(sys.argv[3]), sys.argv[4] == "True")
        return
    jpeg = "--jpeg" in sys.argv
    message = made(jpeg)
    raw = encode(message)
    kind = type(message)
    print(f"{kind.ros_type}, {len(raw)} bytes; load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    writing, reading = median_ms(lambda: encode(message)), median_ms(lambda: decode(kind, raw))
    print(f"codec: writing {writing:.3f} ms, reading {reading:.3f} ms")
    for rate in (30.0, 60.0):
        count = int(10 * rate)
        ages = 1e3 * received(rate, count, jpeg)
        print(
            f"{rate:g} Hz: {len(ages)} of {count} arrived; age median {np.median(ages):.2f} ms, "
            f"p99 {np.percentile(ages, 99):.2f} ms, largest {ages.max():.2f} ms"
        )


if __name__ == "__main__":
    main()
