"""The closed loop: image → points → twist → joint velocities → arm → image, until done or stopped.

Any arm can be driven by any camera on it, real or simulated, but through its `Supervisor` alone, in this
process or another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import FeatureLoss, InputError, InvalidData, NotFinite, ServoStop, StaleImage
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.robots import CameraImage, RobotState
from omniservo.safety.blind_motion import BlindMotion, Waiting
from omniservo.safety.camera_motion import CameraMotion
from omniservo.safety.delay_watch import DelayWatch
from omniservo.safety.feature_watch import FeatureWatch
from omniservo.safety.image_watch import ImageWatch
from omniservo.safety.measured_delays import MeasuredDelays
from omniservo.safety.moving_image import MovingImage
from omniservo.safety.path_controller import CarriedController, PathController
from omniservo.safety.path_watch import PathWatch
from omniservo.safety.seen_points import SeenPoints
from omniservo.safety.supervised_robot import SupervisedRobot
from omniservo.safety.supervisor import Passed, Wish, as_stop
from omniservo.safety.visibility_filter import FilteredTwist, VisibilityFilter

if TYPE_CHECKING:  # what drives an arm loads nothing that reads images
    from omniservo.perception import FeatureTracker

_SETTLING = 0.5
"""The robot is given so long to come to rest at the end [s]."""


class TimeLimit(ServoStop):
    """The goal was not reached in the time that the task allows."""

    reason = "time_limit"


class ControllerReport(Protocol):
    """What a controller's last step saw."""

    @property
    def w(self) -> float:
        """Path parameter; NaN where there is no path."""
        ...

    @property
    def reference_pixels(self) -> FloatArray:
        """(n, 2) where the points should have been [px]."""
        ...

    @property
    def error_px(self) -> float:
        """Rms distance of the points to their reference [px]."""
        ...

    @property
    def goal_error_px(self) -> float:
        """Rms distance of the points to the goal image [px]."""
        ...

    @property
    def initial_T_camera(self) -> RigidTransform:
        """The camera's pose as estimated from the image."""
        ...


Posture: TypeAlias = Callable[[float], tuple[FloatArray, FloatArray]]
"""From the time since the loop's first image [s] to joints (n,) [rad] and their speeds [rad/s]."""

POSTURE_GAIN = 2.0
"""[1/s] with which what the camera leaves free returns to the configuration"""


class Controller(Protocol):
    """What turns pixels into a camera twist: a path tracker or an image servo.

    It may be a `CarriedController` and a `PathController` besides.
    """

    @property
    def report(self) -> ControllerReport | None:
        """Of the last step; None before the first."""
        ...

    @property
    def points(self) -> FloatArray:
        """(n, 3) the points in the initial camera frame, as estimated [m]."""
        ...

    @property
    def done(self) -> bool:
        """True once the goal is reached and the camera may stop."""
        ...

    def predict(self, time: float) -> tuple[FloatArray, BoolArray]:
        """Return where the points are expected at ``time`` [s]: (n, 2) [px], and which of them are."""
        ...

    def step(
        self, time: float, pixels: FloatArray, valid: BoolArray, acts_at: float | None = None
    ) -> FloatArray:
        """Return the camera twist (6,) for the points seen at ``time`` [s].

        Args:
            time: of the exposure.
            pixels: (n, 2) [px].
            valid: (n,) the points seen.
            acts_at: the middle of the time in which the twist will act, as measured [s]; None: unknown.

        Raises:
            ServoStop: there is no twist to stand for.
        """
        ...


@with_field_docs
@dataclass(frozen=True)
class Step:
    """What the loop knows after one control step."""

    time: float
    """of the image's exposure, since the loop's first image [s]"""
    image: CameraImage
    exposure_joints: FloatArray
    """(n,) as read round the image's exposure [rad]"""
    state: RobotState
    pixels: FloatArray
    """(n, 2) [px], NaN where lost"""
    valid: BoolArray
    """(n,)"""
    filtered: FilteredTwist
    """the twist that was commanded, and how it differs from the controller's"""
    passed: Passed
    """the joint velocities that were commanded, and what the supervisor made of them"""
    control_seconds: float
    """pixels in, joint velocities out"""


def servo(
    supervisor: SupervisedRobot,
    controller: Controller,
    features: FeatureTracker,
    visibility: VisibilityFilter,
    *,
    time_limit: float,
    on_step: Callable[[Step], None] = lambda step: None,
    on_wait: Callable[[Waiting], None] = lambda waiting: None,
    posture: Posture | None = None,
) -> ServoStop | None:
    """Drive the robot until the controller is done; the robot stands still on return.

    Without images, or with ones that show too few points, it slows down on its path, stands, and waits, as
    `BlindMotion` says; it goes on when an image shows the points where the joints have them.

    Args:
        supervisor: arm and camera, with what they may do.
        controller: turns points into camera twists.
        features: finds the points near their predicted places.
        visibility: keeps the points in view.
        time_limit: of the whole servo [s].
        on_step: called after every command; what it raises stops the robot.
        on_wait: called when the robot slows down for want of images, and when that is over.
        posture: where joints go in what twists leave free, and near singularities; None: anywhere.

    What stops it latches in the supervisor: nothing moves the robot again until `Supervisor.release`.

    Returns:
        None where the controller finished; else what stopped the robot. Also an `InputError` of whoever takes
        part is a stop, `InvalidData`, once the robot was commanded.

    Raises:
        InputError: before the first command: the parts do not fit together.
        Exception: what else controller, features, ``on_step`` or ``on_wait`` raise; the robot stands still by
            then.
    """
    loop = _Loop(supervisor, controller, features, visibility, posture, on_wait)
    try:
        while not controller.done:
            image = loop.next_image()
            if image.time - loop.start > time_limit:
                raise TimeLimit(_not_there(time_limit, controller.report))
            step = loop.step(image)
            if step is not None:
                on_step(step)
    except BaseException as error:
        stop = as_stop(error)
        try:
            loop.blind.end()
        finally:
            ended = _rest(supervisor, stop)
        refused = isinstance(error, InputError) and loop.commanded
        if not (isinstance(error, ServoStop) or refused):
            raise
        return ended
    return _rest(supervisor, None)


def _rest(supervisor: SupervisedRobot, stop: ServoStop | None) -> ServoStop | None:
    """Bring the robot to rest; return what it was stopped for, or what went wrong meanwhile."""
    try:
        supervisor.stop(stop)
        supervisor.wait(_SETTLING)
    except ServoStop as failed:
        if stop is None:
            return failed
        stop.add_note(f"braking: {failed}")
    return stop


class _Loop:
    """One servo: what it works with, and what it knows from image to image."""

    def __init__(
        self,
        supervisor: SupervisedRobot,
        controller: Controller,
        features: FeatureTracker,
        visibility: VisibilityFilter,
        posture: Posture | None,
        on_wait: Callable[[Waiting], None],
    ) -> None:
        self._supervisor, self._controller, self._features = supervisor, controller, features
        self._visibility, self._posture = visibility, posture
        options = supervisor.options
        self._watch = FeatureWatch(options)
        self._moving = MovingImage(options, visibility.camera.height)
        self._image_watch = ImageWatch(visibility.camera, supervisor.arm, supervisor.flange_T_camera, options)
        self._delay_watch = DelayWatch(visibility.camera, supervisor.arm, supervisor.flange_T_camera, options)
        self._last = -np.inf
        self._delays = MeasuredDelays(options.command_lag, options.image_age)
        path = controller if isinstance(controller, PathController) else None
        self.blind = BlindMotion(supervisor, path, self._delays, on_wait)
        """what is done without images"""
        self._motion = CameraMotion(supervisor, 0.0)
        self._path_watch: PathWatch | None = None
        self._wrong: ServoStop | None = None
        """why the newest image cannot be acted on"""
        self.start = np.nan
        """the time of the first image [s]"""
        self.commanded = False
        """whether the robot may move"""

    def step(self, image: CameraImage) -> Step | None:
        """Command what one image asks for; nothing, if it shows too few points."""
        supervisor, time = self._supervisor, image.time - self.start
        pixels, valid = self._found(image, time)
        state = supervisor.read()
        self._delays.seen(image.time, supervisor.time)
        before = perf_counter()
        try:
            filtered = self._twist(image, time, pixels, valid)
        except ServoStop as stop:
            self._wrong = self._moving.named(stop)
            if isinstance(self._wrong, FeatureLoss):
                return None
            raise self._wrong from None
        self.commanded, self._wrong = True, None
        passed = supervisor.carry(filtered.twist, self._wish)
        self._delays.commanded(supervisor.time)
        self.blind.acted(image, passed)
        seconds = perf_counter() - before
        exposed = supervisor.history.at(np.array([image.time]))[0][0]
        return Step(time, image, exposed, state, pixels, valid, filtered, passed, seconds)

    @property
    def _wish(self) -> Wish | None:
        """Where the arm is to go in what the twist leaves free, and near singularities."""
        return None if self._posture is None else towards(self._posture, self.start)

    def _found(self, image: CameraImage, time: float) -> tuple[FloatArray, BoolArray]:
        """Return the points found (n, 2) [px], as they were at the time stamp, and which (n,)."""
        predicted, expected = self._controller.predict(time)
        self._moving.predict(self._controller.predict, time)
        there = np.where(expected[:, None], predicted + self._moving.displaced(predicted), np.nan)
        pixels, valid = self._features.update(image.pixels, there)
        _refuse_wrong_points(pixels, valid, len(predicted))
        return pixels - self._moving.displaced(pixels), valid

    def _twist(self, image: CameraImage, time: float, pixels: FloatArray, valid: BoolArray) -> FilteredTwist:
        """Return the controller's twist, changed as little as keeps the points in view."""
        supervisor, controller = self._supervisor, self._controller
        twist = self._controlled(image, time, pixels, valid)
        report = controller.report
        if report is None or not np.isfinite(twist).all():
            raise NotFinite(f"the controller gives the twist {np.asarray(twist).tolist()}; it was not sent")
        pose = report.initial_T_camera
        points = pose.inv().apply(controller.points)
        self._watch.check(time, points, valid, report.error_px, report.reference_pixels)
        seen = SeenPoints(image.time, pixels, valid, controller.points, pose, image.time_sigma)
        self._image_watch.check(seen, supervisor.history, alone=self.blind.waiting)
        if self._path_watch is not None:
            self._path_watch.check(supervisor.history.time - self.start)
        self._delay_watch.check(seen, supervisor.history)
        delay = self._delays.first
        return self._visibility.step(
            points, pixels, valid, twist, delay, self._motion.mean_twist(time, time + delay)
        )

    def _controlled(
        self, image: CameraImage, time: float, pixels: FloatArray, valid: BoolArray
    ) -> FloatArray:
        """Return the controller's own twist."""
        controller, acts_at = self._controller, time + self._delays.mean
        if isinstance(controller, CarriedController):
            return controller.step(time, pixels, valid, acts_at, image.time_sigma)
        return controller.step(time, pixels, valid, acts_at)

    def next_image(self) -> CameraImage:
        """Wait for an image newer than the last, and not too old to be acted on."""
        supervisor, limit = self._supervisor, self._supervisor.options.image_age
        while True:
            image = supervisor.image()
            if image is not None and image.time > self._last:
                self._last = image.time
                age = supervisor.read().time - image.earliest
                if age <= limit:
                    self._begin(image.time)
                    return image
                self._wrong = StaleImage(
                    f"the newest image is {age:.3f} s old; at most {limit:g} s is acted on"
                )
            self.blind.pass_time(self._wrong, self._wish)

    def _begin(self, time: float) -> None:
        """Let time be counted from the first image on [s]."""
        if np.isnan(self.start):
            self.start = self.blind.start = time
            self._motion = CameraMotion(self._supervisor, time)
            room = self._supervisor.options.path_room
            if isinstance(self._controller, PathController) and room is not None:
                self._path_watch = PathWatch(self._controller, self._motion, room)
            if isinstance(self._controller, CarriedController):
                self._controller.carried_by(self._motion)


def _not_there(time_limit: float, report: ControllerReport | None) -> str:
    off = "" if report is None else f": the points are {report.goal_error_px:.2f} px (rms) off the goal image"
    return f"not at the goal after {time_limit:g} s{off}"


def _refuse_wrong_points(pixels: FloatArray, valid: BoolArray, count: int) -> None:
    """Raise where features are not what a step can work with."""
    if np.shape(pixels) != (count, 2) or np.shape(valid) != (count,):
        raise InvalidData(
            f"features of shapes {np.shape(pixels)}, {np.shape(valid)} were found; a row for each of the "
            f"{count} points is needed"
        )
    bad = np.asarray(valid) & ~np.isfinite(pixels).all(axis=1)
    if bad.any():
        j = int(np.argmax(bad))
        raise NotFinite(f"point {j} was found at {np.asarray(pixels)[j].tolist()} px")


def towards(posture: Posture, start: float) -> Wish:
    """Return the velocities that lead to the configuration, and on with it."""

    def wish(state: RobotState) -> FloatArray:
        wanted, speeds = posture(state.time - start)
        return speeds + POSTURE_GAIN * (wanted - state.joint_positions)

    return wish
