"""A camera under ROS 2: images of a topic, on this machine's clock, no ROS installed."""

from __future__ import annotations

import math
import threading
import time

from omniservo.cameras.models import CentralModel
from omniservo.errors import ClockFault, ConnectionLost, InputError, InvalidData, ServoStop
from omniservo.geometry.arrays import finite_number
from omniservo.hardware.clock_map import SETTLING, STEP, ClockMap
from omniservo.hardware.ros2.endpoints import why_apart
from omniservo.hardware.ros2.image_pixels import camera_of_info, grey_of_compressed, grey_of_image
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.node import RosNode, Subscription
from omniservo.robots import CameraImage
from omniservo.ros_messages.messages import (
    CameraInfoMessage,
    CompressedImageMessage,
    ImageMessage,
    JointStateMessage,
)

SIGMA = 0.001
"""Standard deviation of a stamp where nothing else is stated [s]."""

SIGMA_OF_ARRIVAL = 0.02
"""That of an arrival in place of a stamp, at least [s]."""

OLDEST = 1.0
"""An image older than this by the clock of joint states is not stamped by it [s]."""

PASSED_OVER = 0.5
"""Messages that are no legal image are passed over for so long [s]: cameras send broken ones now and then."""

_TICK = 0.02


class Ros2Camera:
    """A `CameraSource` of a topic of images: mono8, bgr8, rgb8, bayer_…8, JPEG, PNG.

    An image's time is its stamp on this machine's clock. What every image needs at least to get here cannot
    be distinguished from an offset of the clocks; where the stamps of joint states are of the same clock,
    name their topic: they arrive within a millisecond.

    Args:
        topic: of `sensor_msgs/msg/Image`, or of `CompressedImage` where it ends in "/compressed".
        clock_topic: of `sensor_msgs/msg/JointState` whose stamps are of the images' clock; "": none.
        network: where the camera is.
        reliable: whether lost parts are sent again; a publisher of best effort is refused then.
        time_sigma: standard deviation of a stamp [s].
        patience: how long a first image is waited for [s].

    Raises:
        InputError: an image that is not legal, a topic of another type, incompatible QoS, Cyclone DDS is not
            installed.
        ConnectionLost: no image within ``patience``.
    """

    def __init__(
        self,
        topic: str,
        *,
        clock_topic: str = "",
        network: DdsNetwork | None = None,
        reliable: bool = False,
        time_sigma: float = SIGMA,
        patience: float = 5.0,
    ) -> None:
        self._sigma = finite_number("time_sigma", time_sigma, minimum=0.0)
        self._patience = finite_number("patience", patience, above=0.0)
        self.notice: str | None = None
        """what is assumed of the images' times, in words; None where they have stamps"""
        self._clock = ClockMap()
        self._clock_begun = math.inf
        """when the first stamp of the clock topic came [s]"""
        self._image: CameraImage | None = None
        self._fault: ServoStop | None = None
        self._wrong, self._taken = "", time.monotonic()
        """what is wrong with the newest message; when the newest image was taken in [s]"""
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._node = RosNode(network or DdsNetwork())
        self._thread = threading.Thread(target=self._run, name="ros2-camera", daemon=True)
        kind: type[ImageMessage | CompressedImageMessage]
        kind = CompressedImageMessage if topic.endswith("/compressed") else ImageMessage
        self._kind = kind
        try:
            self._heard: Subscription[ImageMessage | CompressedImageMessage] = self._node.subscribe(
                topic, kind, reliable=reliable, depth=4
            )
            self._joints = self._node.subscribe(clock_topic, JointStateMessage) if clock_topic else None
            self._thread.start()
            self._open()
        except BaseException:
            self.close()
            raise

    @property
    def clock(self) -> ClockMap | None:
        """From stamps to this machine's time; None: images have none."""
        return None if self.notice else self._clock

    def image(self) -> CameraImage | None:
        """Return the newest image, without waiting.

        Raises:
            ConnectionLost: no one publishes images any more.
            ClockFault: the camera's clock was set, or its stamps are not of the clock topic's clock.
            InvalidData: for `PASSED_OVER` no message was a legal image, of the size of those before.
        """
        with self._lock:
            if self._closing.is_set():
                raise ConnectionLost("the connection was closed")
            if self._fault is not None:
                raise type(self._fault)(str(self._fault))
            if self._is_wrong:
                raise InvalidData(f"{self._heard.topic}: {self._wrong}")
            return self._image

    def close(self) -> None:
        """Leave the domain; a second call does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._node.close()

    @property
    def _is_wrong(self) -> bool:
        return bool(self._wrong) and time.monotonic() - self._taken > PASSED_OVER

    def _run(self) -> None:
        while not self._closing.is_set():
            try:
                self._heard.wait(_TICK)
                messages, arrival = self._heard.take(), time.monotonic()
                for joints in self._joints.take() if self._joints is not None else []:
                    if joints.header.stamp.seconds > 0.0:
                        self._clock_begun = min(self._clock_begun, arrival)
                        self._clock.monotonic(joints.header.stamp.seconds, arrival)
                times = [self._time_of(message.header.stamp.seconds, arrival) for message in messages]
                if messages and times[-1] is not None:  # decoding takes time: only the newest one
                    self._take(messages[-1], *times[-1])
                gone = self._image is not None and self._heard.matched == 0
                fault: ServoStop | None = ConnectionLost(f"{self._heard.topic}: its publisher is gone")
            except Exception as error:  # a thread that dies in silence would be worse
                gone = True
                fault = (
                    error if isinstance(error, ServoStop) else InvalidData(f"{self._heard.topic}: {error}")
                )
            if gone:
                with self._lock:
                    self._fault = self._fault or fault
                self._closing.wait(_TICK)

    def _time_of(self, stamp: float, arrival: float) -> tuple[float, float] | None:
        """Return an image's time on this machine's clock and its sigma [s]; None: not known yet."""
        if stamp <= 0.0:
            self.notice = (
                f"{self._heard.topic}: images have no time stamp; their arrival is taken as exposure"
            )
            return arrival, max(self._sigma, SIGMA_OF_ARRIVAL)
        if self._joints is None:
            return self._clock.monotonic(stamp, arrival), self._sigma
        if math.isnan(self._clock.offset):
            return None
        at = stamp + self._clock.offset
        # the first joint states may have come late, and the clock's map with them
        ahead = STEP if arrival - self._clock_begun > SETTLING else OLDEST
        if not -OLDEST <= at - arrival <= ahead:
            where = f"{at - arrival:.3f} s ahead of" if at > arrival else f"{arrival - at:.3f} s old by"
            raise ClockFault(
                f"{self._heard.topic}: an image is {where} the clock of {self._joints.topic}: another clock "
                "stamps it; set one by the other (NTP, PTP)"
            )
        return min(at, arrival), self._sigma

    def _take(self, message: ImageMessage | CompressedImageMessage, at: float, sigma: float) -> None:
        try:
            if isinstance(message, CompressedImageMessage):
                pixels = grey_of_compressed(message)
            else:
                pixels = grey_of_image(message)
        except InputError as error:
            self._wrong = str(error)
            return
        with self._lock:
            before = self._image
            if before is not None and before.pixels.shape != pixels.shape:
                (h, w), (was_h, was_w) = pixels.shape, before.pixels.shape
                self._wrong = f"an image of {w}×{h} pixels; those before had {was_w}×{was_h}"
            elif before is None or at > before.time:
                self._wrong, self._image = "", CameraImage(at, pixels, sigma)
                self._taken = time.monotonic()

    def _open(self) -> None:
        end = time.monotonic() + self._patience
        while self._image is None:
            if self._fault is not None or self._is_wrong:
                where = self._heard.topic
                raise self._fault or InputError(f"{where}: {self._wrong}")
            if time.monotonic() > end:
                raise self._no_image()
            self._closing.wait(_TICK)

    def _no_image(self) -> InputError | ConnectionLost:
        graph, topic = self._node.endpoints, self._heard.topic
        theirs = graph.publishers()
        found = [each for each in theirs if each.topic == topic]
        own = next((each for each in graph.subscribers(topic) if each.key == self._heard.key), None)
        why = why_apart(topic, self._kind.ros_type, own, found, theirs, "publishes")
        words = f"no image in {self._patience:g} s in {self._node.network}: {why or self._silence()}"
        return InputError(words) if found and why else ConnectionLost(words)

    def _silence(self) -> str:
        if self._heard.refused or self._wrong:
            return self._heard.refusal or self._wrong
        if self._joints is not None and math.isnan(self._clock.offset):
            return f"{self._joints.topic} has no time stamps, which images were to be timed by"
        large = "large images lose parts on the way: raise net.core.rmem_max, or take the compressed topic"
        return f"{self._heard.topic} has a publisher, and nothing arrives ({large})"


def read_camera_info(topic: str, network: DdsNetwork | None = None, patience: float = 5.0) -> CentralModel:
    """Return the camera that a topic of `sensor_msgs/msg/CameraInfo` tells.

    Args:
        topic: "/camera/camera_info".
        network: where the camera is.
        patience: how long it is waited for [s].

    Raises:
        InputError: another distortion model, a camera that is not calibrated, a topic of another type.
        ConnectionLost: no message within ``patience``.
    """
    node = RosNode(network or DdsNetwork())
    try:
        heard = node.subscribe(topic, CameraInfoMessage, depth=1)
        end = time.monotonic() + finite_number("patience", patience, above=0.0)
        while time.monotonic() < end:
            heard.wait(_TICK)
            for message in heard.take():
                return camera_of_info(message)
        theirs = node.endpoints.publishers()
        found = [each for each in theirs if each.topic == topic]
        why = why_apart(topic, CameraInfoMessage.ros_type, None, found, theirs, "publishes")
        words = f"no CameraInfo in {patience:g} s in {node.network}: {why or f'{topic} is silent'}"
        raise InputError(words) if found and why else ConnectionLost(words)
    finally:
        node.close()
