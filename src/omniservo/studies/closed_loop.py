"""One closed loop on projected points: images are taken, arrive, and move a free camera."""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.studies.study import Study
from omniservo.studies.study_camera import StudyCamera, StudyImage
from omniservo.studies.study_controller import Led
from omniservo.studies.study_scene import StudyScene

LONGEST = 1.0 / 30.0
"""[s] between two poses that are noted. The way between them counts as straight: at 0.5 m/s and 1.5 rad/s
that is at most 0.1 mm off."""

HOLD = 0.25
"""[s] that a twist acts at most: after so long without an image the camera stands"""

SETTLING = 2.0
"""[s] that a run goes on after its controller says for the first time that the goal is reached: a law that
comes down exponentially says so while its slowest direction is still under way"""


@dataclass(eq=False)
class Trajectory:
    """Where the camera truly was: at every image, when its twist changed, and at least every `LONGEST`."""

    times: list[float] = field(default_factory=list)
    """[s]"""
    rotations: list[FloatArray] = field(default_factory=list)
    """(3, 3) of initial_T_camera"""
    places: list[FloatArray] = field(default_factory=list)
    """(3,) of the camera's centre in the initial camera frame [m]"""
    feature_lost: bool = False
    """a point left the image, or an obstacle hid it"""
    images: int = 0
    """that were taken"""

    @property
    def centres(self) -> FloatArray:
        """(k, 3) [m]."""
        return np.array(self.places)

    @property
    def end(self) -> RigidTransform:
        """The last initial_T_camera."""
        return RigidTransform.from_components(self.places[-1], Rotation.from_matrix(self.rotations[-1]))

    @property
    def length(self) -> float:
        """Of the camera's way [m]."""
        return float(np.linalg.norm(np.diff(self.centres, axis=0), axis=1).sum())

    def farthest(self, place: FloatArray) -> float:
        """Return the largest distance of the camera's centre to a place (3,) [m]."""
        return float(np.linalg.norm(self.centres - place, axis=1).max())

    def least_gap(self, scene: StudyScene) -> float | None:
        """Return the smallest distance of the camera's centre to an obstacle [m]; None: there is none."""
        if not scene.obstacles:
            return None
        begin, gaps = self.centres, []
        way = np.diff(begin, axis=0, append=begin[-1:])
        squared = np.maximum((way**2).sum(axis=1), 1e-30)
        for ball in scene.obstacles:
            along = np.clip(((ball.center - begin) * way).sum(axis=1) / squared, 0.0, 1.0)
            near = begin + along[:, None] * way
            gaps.append(float(np.linalg.norm(near - ball.center, axis=1).min()) - ball.radius)
        return min(gaps)


@dataclass(frozen=True, eq=False)
class Ended:
    """How a loop ended."""

    status: str
    """"converged", "timed_out" or "stopped" """
    reason: str
    trajectory: Trajectory


class ClosedLoop:
    """Runs a controller on a scene until it is done, stops by a named error, or its time is over.

    An image acts when it arrives; one that arrives after a newer one is not used. Between changes of the
    twist the camera moves by its exponential map.
    """

    def __init__(self, study: Study, scene: StudyScene, camera: StudyCamera, led: Led) -> None:
        self._scene, self._camera, self._led = scene, camera, led
        self._period = 1.0 / study.images.rate
        self._most = study.limits.seconds
        self._rotation, self._centre, self._time = np.eye(3), np.zeros(3), 0.0
        self._twist, self._since, self._newest = np.zeros(6), 0.0, -1.0
        self._arrived = math.inf
        self.trajectory = Trajectory()
        self._note()

    def run(self) -> Ended:
        """Run it once, from the initial pose."""
        waiting: list[tuple[float, float, int]] = []
        images: dict[int, StudyImage] = {}
        try:
            for number in range(int(self._most / self._period) + 1):
                exposed = number * self._period
                while waiting and waiting[0][0] <= exposed:
                    if self._act(*heapq.heappop(waiting), images):
                        return Ended("converged", "", self.trajectory)
                self._move(exposed)
                image = self._camera.take(self._rotation, self._centre)
                self.trajectory.images += 1
                self.trajectory.feature_lost |= not bool(image.in_view.all())
                arrival = self._camera.arrival(exposed)
                if arrival is not None:
                    images[number] = image
                    heapq.heappush(waiting, (arrival, exposed, number))
        except ServoStop as stop:
            return Ended("stopped", f"{stop.reason}: {stop}", self.trajectory)
        return Ended("timed_out", f"not done after {self._most:g} s", self.trajectory)

    def _act(self, arrival: float, exposed: float, number: int, images: dict[int, StudyImage]) -> bool:
        """Let an image that arrives change the twist; return whether the run is over."""
        self._move(arrival)
        image = images.pop(number)
        if exposed <= self._newest:
            return False
        self._newest, rows = exposed, self._led.followed
        acts_at = arrival + 0.5 * self._period
        self._twist = self._led.controller.step(exposed, image.pixels[rows], image.found[rows], acts_at)
        self._since = arrival
        if self._led.controller.done:
            self._arrived = min(self._arrived, exposed)
        return exposed >= self._arrived + SETTLING

    def _move(self, until: float) -> None:
        """Let the camera move until a time [s]."""
        if until <= self._time:
            return
        acting = min(until, max(self._since + HOLD, self._time)) - self._time
        if acting > 0.0 and self._twist.any():
            pieces, begin = max(math.ceil(acting / LONGEST - 1e-9), 1), self._time
            turn, shift = exponential_map(acting / pieces * self._twist)
            for k in range(1, pieces + 1):
                self._centre = self._centre + self._rotation @ shift
                self._rotation, self._time = self._rotation @ turn, begin + acting * k / pieces
                if k < pieces:
                    self._note()
        self._time = until
        self._note()

    def _note(self) -> None:
        self.trajectory.times.append(self._time)
        self.trajectory.rotations.append(self._rotation)
        self.trajectory.places.append(self._centre)


def exponential_map(motion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotation (3, 3) and translation (3,) [m] of exp of a twist times a time (6,): υ [m], ω [rad].

    R = I + a[ω]× + b[ω]×² and t = (I + b[ω]× + c[ω]×²) υ, with a = sin θ/θ, b = (1 − cos θ)/θ² and
    c = (1 − a)/θ². `RigidTransform.from_exp_coords` has the same, and checks that take longer than all else
    between two images.
    """
    vx, vy, vz, x, y, z = motion.tolist()
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < 0.02:  # by their series, where the differences would lose digits
        a, b = 1.0 - square / 6.0 * (1.0 - square / 20.0), 0.5 - square / 24.0 * (1.0 - square / 30.0)
        c = 1.0 / 6.0 - square / 120.0 * (1.0 - square / 42.0)
    else:
        a, b = math.sin(angle) / angle, 2.0 * math.sin(0.5 * angle) ** 2 / square
        c = (1.0 - a) / square
    turn = np.array(
        [
            [1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y],
            [b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x],
            [b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)],
        ]
    )
    along, rest = c * (x * vx + y * vy + z * vz), 1.0 - c * square
    shift = np.array(
        [
            rest * vx + along * x + b * (y * vz - z * vy),
            rest * vy + along * y + b * (z * vx - x * vz),
            rest * vz + along * z + b * (x * vy - y * vx),
        ]
    )
    return turn, shift
