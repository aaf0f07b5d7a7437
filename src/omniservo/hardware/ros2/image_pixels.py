"""Grey values out of ROS 2 image messages, and a camera's model out of its CameraInfo."""

from __future__ import annotations

import io
from dataclasses import asdict

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from omniservo.camera_files.calibration_file import CalibrationFile
from omniservo.camera_files.formats import ros
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import ByteArray
from omniservo.ros_messages.messages import CameraInfoMessage, CompressedImageMessage, ImageMessage

MOST_PIXELS = 50_000_000
"""Largest image that is taken."""

_PNG_DEPTH = 24
"""The byte of a PNG that states the bits of a channel: behind signature, IHDR's head, width and height."""

ENCODINGS: dict[str, tuple[int, int | None]] = {
    "mono8": (1, None),
    "8UC1": (1, None),
    "bgr8": (3, cv2.COLOR_BGR2GRAY),
    "8UC3": (3, cv2.COLOR_BGR2GRAY),
    "rgb8": (3, cv2.COLOR_RGB2GRAY),
    "bgra8": (4, cv2.COLOR_BGRA2GRAY),
    "rgba8": (4, cv2.COLOR_RGBA2GRAY),
    # ROS names a mosaic by its first two pixels; OpenCV by the second row's second and third.
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2GRAY),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2GRAY),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2GRAY),
}
"""Encodings that are read, with bytes of a pixel and OpenCV's conversion to grey."""


def grey_of_image(message: ImageMessage) -> ByteArray:
    """Return an image's grey values (height, width).

    Raises:
        InputError: another encoding, no pixels or too many, rows that do not fit; the field is named.
    """
    if message.encoding not in ENCODINGS:
        legal = ", ".join(ENCODINGS)
        raise InputError(f"{message.ros_type}.encoding: {spelled(message.encoding)} given; legal: {legal}")
    size, conversion = ENCODINGS[message.encoding]
    height, width, step = message.height, message.width, message.step
    _refuse_size(message.ros_type, width, height)
    if step < width * size:
        raise InputError(f"{message.ros_type}.step: {step} given; {width} pixels are {width * size} bytes")
    if len(message.data) != step * height:
        raise InputError(
            f"{message.ros_type}.data: {len(message.data)} bytes; {height} rows are {step * height}"
        )
    rows = message.data.reshape(height, step)[:, : width * size]
    if conversion is None:
        return np.ascontiguousarray(rows)
    pixels = np.ascontiguousarray(rows).reshape((height, width) if size == 1 else (height, width, size))
    return np.asarray(cv2.cvtColor(pixels, conversion), dtype=np.uint8)


def grey_of_compressed(message: CompressedImageMessage) -> ByteArray:
    """Return a compressed image's grey values (height, width); its size is read before it is decoded.

    Raises:
        InputError: neither JPEG nor PNG, no pixels or too many, of 16 bits, or broken.
    """
    data = message.data.tobytes()
    where = f"{message.ros_type}.data"
    try:
        with Image.open(io.BytesIO(data), formats=("JPEG", "PNG")) as head:
            (width, height), kind = head.size, head.format
    except UnidentifiedImageError:
        raise InputError(f"{where}: not an image; legal: JPEG, PNG") from None
    except Exception as error:  # the readers of formats raise whatever they meet
        raise InputError(f"{where}: not an image that can be read: {spelled(str(error))}") from None
    _refuse_size(message.ros_type, width, height)
    # of 12 bits in 16 the decoder would leave a black image; Pillow's modes tell only grey ones
    if kind == "PNG" and data[_PNG_DEPTH] > 8:
        raise InputError(f"{where}: 16 bits a pixel; legal: 8")
    pixels = cv2.imdecode(message.data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels is None or pixels.shape != (height, width):
        raise InputError(f"{where}: an image that is broken")
    # image_transport compresses a mosaic as it is, and says so: "bayer_rggb8; jpeg compressed"
    size, conversion = ENCODINGS.get(message.format.partition(";")[0].strip(), (0, None))
    if size == 1 and conversion is not None:
        pixels = cv2.cvtColor(pixels, conversion)
    return np.asarray(pixels, dtype=np.uint8)


def camera_of_info(message: CameraInfoMessage) -> CentralModel:
    """Return the camera of a CameraInfo: plumb_bob, rational_polynomial or equidistant.

    Raises:
        InputError: another distortion model, a camera that is not calibrated, a part of the sensor.
    """
    fields = {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in asdict(message).items()
    }
    if not any(fields["k"]):
        raise InputError(f"{message.ros_type}.k: all zeros: the camera is not calibrated")
    file = CalibrationFile(message.ros_type, fields, lambda path: 0)
    return ros.read(file, "")


def _refuse_size(name: str, width: int, height: int) -> None:
    if not 0 < width * height <= MOST_PIXELS:
        raise InputError(f"{name}: {width}×{height} pixels; legal: 1 to {MOST_PIXELS}")
