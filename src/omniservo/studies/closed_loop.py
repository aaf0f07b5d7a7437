"""One closed loop on projected points: images are taken, arrive, and move the camera."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass
from typing import Protocol

from omniservo.errors import JointLimit, ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.studies.arm_carrier import ArmCarrier
from omniservo.studies.free_carrier import FreeCarrier
from omniservo.studies.study import Study
from omniservo.studies.study_camera import StudyCamera, StudyImage
from omniservo.studies.study_controller import Led
from omniservo.studies.study_scene import StudyScene
from omniservo.studies.trajectory import Trajectory

SETTLING = 2.0
"""[s] that a run goes on after its controller says for the first time that the goal is reached: a law that
comes down exponentially says so while its slowest direction is still under way"""


class Carrier(Protocol):
    """What moves the camera; `FreeCarrier` and `ArmCarrier` are ones."""

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) of initial_T_camera."""
        ...

    @property
    def centre(self) -> FloatArray:
        """(3,) of the camera, in the initial camera frame [m]."""
        ...

    def carry(self, twist: FloatArray) -> None:
        """Move by this twist (6,) from now on."""
        ...

    def move(self, until: float) -> None:
        """Let time pass until then [s]."""
        ...

    def brake(self, stop: ServoStop) -> None:
        """Bring the camera to rest."""
        ...


@dataclass(frozen=True, eq=False)
class Ended:
    """How a loop ended."""

    status: str
    """"converged", "timed_out" or "stopped" """
    reason: str
    trajectory: Trajectory
    joint_limit: bool = False
    """a joint would have left its range, or the arm became singular"""


class ClosedLoop:
    """Runs a controller on a scene until it is done, stops by a named error, or its time is over.

    An image acts when it arrives; one that arrives after a newer one is not used.
    """

    def __init__(self, study: Study, scene: StudyScene, camera: StudyCamera, led: Led) -> None:
        self._scene, self._camera, self._led = scene, camera, led
        self._period = 1.0 / study.images.rate
        self._most = study.limits.seconds
        self._newest, self._arrived = -1.0, math.inf
        self.trajectory = Trajectory()
        self._carrier: Carrier
        if scene.arm is None:
            self._carrier = FreeCarrier(self.trajectory)
        else:
            self._carrier = ArmCarrier(scene.arm, study.servo, led.posture, self.trajectory)

    def run(self) -> Ended:
        """Run it once, from the initial pose."""
        waiting: list[tuple[float, float, int]] = []
        images: dict[int, StudyImage] = {}
        carrier = self._carrier
        try:
            for number in range(int(self._most / self._period) + 1):
                exposed = number * self._period
                while waiting and waiting[0][0] <= exposed:
                    if self._act(*heapq.heappop(waiting), images):
                        return Ended("converged", "", self.trajectory)
                carrier.move(exposed)
                self._put_elsewhere(exposed)
                image = self._camera.take(carrier.rotation, carrier.centre)
                self.trajectory.images += 1
                self.trajectory.feature_lost |= not bool(image.in_view.all())
                arrival = self._camera.arrival(exposed)
                if arrival is not None:
                    images[number] = image
                    heapq.heappush(waiting, (arrival, exposed, number))
        except ServoStop as stop:
            carrier.brake(stop)
            limit = isinstance(stop, JointLimit)
            return Ended("stopped", f"{stop.reason}: {stop}", self.trajectory, limit)
        return Ended("timed_out", f"not done after {self._most:g} s", self.trajectory)

    def _put_elsewhere(self, exposed: float) -> None:
        """Carry out the scene's move once it is due; a method that plans again is given where balls are."""
        moved = self._scene.moved
        if moved is not None and exposed >= moved.time:
            self._scene = self._scene.after_move
            self._camera.see(self._scene)
            if self._led.given_obstacles is not None:
                self._led.given_obstacles(moved.obstacles)

    def _act(self, arrival: float, exposed: float, number: int, images: dict[int, StudyImage]) -> bool:
        """Let an image that arrives change the twist; return whether the run is over."""
        self._carrier.move(arrival)
        image = images.pop(number)
        if exposed <= self._newest:
            return False
        self._newest, rows = exposed, self._led.followed
        acts_at = arrival + 0.5 * self._period
        twist = self._led.controller.step(exposed, image.pixels[rows], image.found[rows], acts_at)
        self._carrier.carry(twist)
        if self._led.controller.done:
            self._arrived = min(self._arrived, exposed)
        return exposed >= self._arrived + SETTLING
