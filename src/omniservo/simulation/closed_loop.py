"""The closed loop: image → points → twist → joint velocities → robot → image, until done or stopped.

It knows nothing of the simulator: any `Robot` can be driven, with ``wait`` letting time pass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Protocol

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import JointLimit, ServoStop, StaleImage
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.perception import FeatureTracker
from omniservo.robots import Arm, CameraImage, Robot, RobotState

JOINT_RESERVE = np.deg2rad(1.0)
"""The arm is stopped when a joint would come nearer to its range within a frame [rad]."""

_TICK = 1e-3
"""How often the loop looks for a new image [s]."""


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


class Controller(Protocol):
    """What turns pixels into a camera twist: a path tracker or an image servo."""

    @property
    def report(self) -> ControllerReport | None:
        """Of the last step; None before the first."""
        ...

    @property
    def done(self) -> bool:
        """True once the goal is reached and the camera may stop."""
        ...

    def predict(self, time: float) -> tuple[FloatArray, BoolArray]:
        """Return where the points are expected at ``time`` [s]: (n, 2) [px], and which of them are."""
        ...

    def step(self, time: float, pixels: FloatArray, valid: BoolArray) -> FloatArray:
        """Return the camera twist (6,) for the points seen at ``time`` [s].

        Raises:
            ServoStop: there is no twist to stand for.
        """
        ...


@dataclass(frozen=True)
class Step:
    """What the loop knows after one control step."""

    time: float
    """of the image's exposure, since the loop's first image [s]"""
    image: CameraImage
    state: RobotState
    pixels: FloatArray
    """(n, 2) [px], NaN where lost"""
    valid: BoolArray
    """(n,)"""
    twist: FloatArray
    """(6,) commanded"""
    joint_velocities: FloatArray
    """(n,) commanded [rad/s]"""
    control_seconds: float
    """pixels in, joint velocities out"""


def servo(
    robot: Robot,
    arm: Arm,
    flange_T_camera: RigidTransform,
    controller: Controller,
    features: FeatureTracker,
    *,
    wait: Callable[[float], None],
    on_step: Callable[[Step], None],
    image_age: float,
    time_limit: float,
) -> ServoStop | None:
    """Drive the robot until the controller is done; the robot stands still on return.

    Args:
        robot: the arm with its camera.
        arm: its kinematics.
        flange_T_camera: how the camera sits on it.
        controller: turns points into camera twists.
        features: finds the points near their predicted places.
        wait: lets the given time [s] pass.
        on_step: called after every command.
        image_age: the oldest image that is acted on [s].
        time_limit: of the whole servo [s].

    Returns:
        None where the controller finished; else what stopped the arm.
    """
    try:
        image = _next_image(robot, None, wait, image_age)
        start = image.time
        while not controller.done:
            if image.time - start > time_limit:
                raise TimeLimit(f"not at the goal after {time_limit:g} s")
            predicted, expected = controller.predict(image.time - start)
            pixels, valid = features.update(image.pixels, np.where(expected[:, None], predicted, np.nan))
            state = robot.read()
            before = perf_counter()
            twist = controller.step(image.time - start, pixels, valid)
            velocities = arm.joint_velocities(state.joint_positions, twist, flange_T_camera)
            seconds = perf_counter() - before
            _refuse_joint_limit(arm, state.joint_positions, velocities)
            robot.command(velocities)
            on_step(Step(image.time - start, image, state, pixels, valid, twist, velocities, seconds))
            image = _next_image(robot, image, wait, image_age)
    except ServoStop as stop:
        return stop
    finally:
        robot.stop()
        wait(0.5)
    return None


def _next_image(
    robot: Robot, last: CameraImage | None, wait: Callable[[float], None], image_age: float
) -> CameraImage:
    """Wait for an image newer than ``last``; refuse one that is too old, or that does not come."""
    waited = 0.0
    while True:
        image = robot.image()
        if image is not None and (last is None or image.time > last.time):
            age = robot.read().time - image.time
            if age > image_age:
                raise StaleImage(f"the newest image is {age:.3f} s old; at most {image_age:g} s is acted on")
            return image
        if waited > image_age:
            raise StaleImage(f"no new image for {waited:.3f} s; at most {image_age:g} s is waited")
        wait(_TICK)
        waited += _TICK


def _refuse_joint_limit(arm: Arm, joints: FloatArray, velocities: FloatArray) -> None:
    """Stop when a joint moves towards the end of its range and would arrive within 0.1 s."""
    ahead = joints + 0.1 * velocities
    low, high = arm.joint_range[:, 0] + JOINT_RESERVE, arm.joint_range[:, 1] - JOINT_RESERVE
    leaving = ((ahead < low) & (velocities < 0)) | ((ahead > high) & (velocities > 0))
    if leaving.any():
        j = int(np.argmax(leaving))
        raise JointLimit(
            f"{arm.joint_names[j]} at {np.rad2deg(joints[j]):.1f} deg would leave its range "
            f"{np.rad2deg(arm.joint_range[j, 0]):.1f} … {np.rad2deg(arm.joint_range[j, 1]):.1f} deg"
        )
    if (np.abs(velocities) > arm.joint_speed).any():
        j = int(np.argmax(np.abs(velocities) / arm.joint_speed))
        raise JointLimit(
            f"{arm.joint_names[j]} would turn with {np.rad2deg(abs(velocities[j])):.0f} deg/s; "
            f"at most {np.rad2deg(arm.joint_speed[j]):.0f} deg/s"
        )
