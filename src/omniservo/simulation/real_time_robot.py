"""The simulated arm and camera on the wall's clock, for other threads and, by servers, other processes."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import replace
from threading import Event, Lock, Thread

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InvalidData
from omniservo.geometry.arrays import FloatArray
from omniservo.hardware import JointHistory
from omniservo.robots import ArmMode, CameraImage, RobotState
from omniservo.scenes import Scene
from omniservo.simulation.largest_image import refuse_larger
from omniservo.simulation.projected_dots import ProjectedDots
from omniservo.simulation.simulated_robot import Exposure, SimulatedRobot
from omniservo.simulation.unified_renderer import UnifiedRenderer
from omniservo.simulation.world import TICK

_LOOK = 2e-3
"""The arm is moved on so often where no one asks for it [s]."""

_ENOUGH = 0.95
"""share of the camera's frames that keeps up with its rate"""

_COUNTED = 30
"""frames over which that is judged"""


class RealTimeRobot:
    """An `ArmDriver` and `CameraSource` that is moved by `time.monotonic()`; any thread may call it.

    A frame is rendered by a thread of its own, beside which joints are read and commanded, and is delivered
    the sensor's latency after its exposure, or as soon as it is there. Frames that are due while another is
    rendered are left out, as `behind` says.

    Args:
        scene: the world.
        seed: of the sensor's noise.
        rendered: False: frames come empty, (0, 0), and in time; `joints_at` says where points are then.
        projected: frames are not rendered, but show the scene's dots alone; see `ProjectedDots`.

    Raises:
        InputError: as `SimulatedRobot`, or frames are rendered of a camera of more than 2²⁵ pixels.
    """

    def __init__(
        self, scene: Scene, seed: int = 0, *, rendered: bool = True, projected: bool = False
    ) -> None:
        if rendered:
            refuse_larger(scene.camera)
        self._dots = ProjectedDots(scene) if projected else None
        soonest = replace(scene.sensor, latency=min(scene.sensor.half_span, scene.sensor.latency))
        self._robot = SimulatedRobot(replace(scene, sensor=soonest), seed, rendered=False)
        self._scene, self._rendered = scene, rendered
        self._lock = Lock()
        self._begin = time.monotonic()
        self._motion = JointHistory(scene.arm.dof)
        self._mode = ArmMode.READY
        self._picture: CameraImage | None = None
        self._waiting: deque[CameraImage] = deque()
        self._numbers: deque[int] = deque(maxlen=_COUNTED)
        self._failure = ""
        self._ended = Event()
        self._threads = [Thread(target=work, daemon=True) for work in (self._move, self._take_pictures)]
        for thread in self._threads:
            thread.start()

    @property
    def behind(self) -> str | None:
        """What to say where no frame comes any more, or rendering takes too long; None: it keeps up."""
        if self._failure:
            return self._failure
        numbers = list(self._numbers)
        if len(numbers) < _COUNTED:
            return None
        share = (len(numbers) - 1) / (numbers[-1] - numbers[0])
        if share >= _ENOUGH:
            return None
        rate = self._scene.sensor.rate
        # dots that are drawn take no longer in larger images, and are not found in much smaller ones
        smaller = ", or smaller images (--size)" if self._dots is None else ""
        return (
            f"this machine makes {share * rate:.1f} frames a second; the camera has {rate:g}: take a lower "
            f"--rate{smaller}"
        )

    def read(self) -> RobotState:
        """Return the joints as they are now."""
        with self._lock:
            self._catch_up()
            return self._state()

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives.

        Raises:
            InvalidData: frames cannot be rendered any more.
        """
        if self._failure:
            raise InvalidData(self._failure)
        with self._lock:
            self._let_arrive()
            return self._picture

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Move with these joint velocities (n,) [rad/s] until commanded otherwise.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        with self._lock:
            self._catch_up()
            if self._mode is ArmMode.READY:
                self._robot.command(joint_velocities)

    def stop(self) -> None:
        """Brake to standstill with 99% of the joints' acceleration limits."""
        with self._lock:
            self._catch_up()
            self._robot.stop()

    def set_mode(self, mode: ArmMode) -> None:
        """Let the arm's controller be in this mode; in all but READY it brakes and obeys no command."""
        with self._lock:
            self._catch_up()
            self._mode = mode
            if mode is not ArmMode.READY:
                self._robot.stop()

    def joints_at(self, times: npt.ArrayLike) -> FloatArray:
        """Return truth: the joints (…, n) [rad] at times (…) of the last two seconds [s].

        Raises:
            InputError: a time is not a finite number.
        """
        with self._lock:
            self._catch_up()
        return self._motion.at(times)

    def world_T_camera(self, time: float) -> RigidTransform:
        """Return truth: the camera's pose at a time of the last two seconds [s].

        Raises:
            InputError: it is not a finite number.
        """
        return self._scene.world_T_camera(self.joints_at(time))

    def close(self) -> None:
        """End the threads; a second call does nothing."""
        self._ended.set()
        for thread in self._threads:
            thread.join()
        with self._lock:
            self._robot.close()

    def _catch_up(self) -> None:
        """Move the arm on to the last whole millisecond before now: its stamps never lie ahead."""
        behind = time.monotonic() - self._begin - self._robot.time
        if behind >= TICK:
            self._robot.advance(behind // TICK * TICK)
        self._motion.add(self._state())

    def _state(self) -> RobotState:
        state = self._robot.read()
        return replace(state, time=self._begin + state.time, mode=self._mode)

    def _move(self) -> None:
        while not self._ended.wait(_LOOK):
            with self._lock:
                self._catch_up()

    def _take_pictures(self) -> None:
        try:
            self._render()
        except Exception as error:  # whoever waits for images is told, in place of waiting on
            self._failure = f"no more images: {type(error).__name__}: {error}"

    def _render(self) -> None:
        last, renderer = -np.inf, None
        while not self._ended.wait(_LOOK):
            with self._lock:
                exposure = self._robot.newest_exposure()
                self._robot.forget()
            if exposure is None or exposure.time == last:
                continue
            last, pixels = exposure.time, np.zeros((0, 0), dtype=np.uint8)
            if self._dots is not None:
                pixels = self._dots.drawn(exposure)
            elif self._rendered:
                if renderer is None or renderer.world is not exposure.world:
                    renderer = UnifiedRenderer(exposure.world)
                pixels = exposure.photographed(renderer)
            self._deliver(exposure, CameraImage(self._begin + last, pixels))

    def _deliver(self, exposure: Exposure, image: CameraImage) -> None:
        with self._lock:
            self._numbers.append(exposure.noise[1])
            self._waiting.append(image)
            self._let_arrive()  # nobody may ask

    def _let_arrive(self) -> None:
        due = time.monotonic() - self._scene.sensor.latency
        while self._waiting and self._waiting[0].time <= due:
            self._picture = self._waiting.popleft()
