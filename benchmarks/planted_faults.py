"""What may break while an arm moves: each fault as what it does to readings, images, points and drives."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from benchmarks.driven_arm import DrivenArm

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.robots import CameraImage, RobotState

Told: TypeAlias = Literal["at once", "image age", "joints", "points"]
"""From when a fault can be told: from its first reading, call or image on; once the newest image is as old as
that of a sound robot may be; once the joints read are not where drives within their bounds would have
them; once more than a quarter of the points are off by more than a sound image's may be."""


NUDGED_IN = 0.3
"""[s]"""


@dataclass(frozen=True)
class Fault:
    """One thing that breaks, at a time."""

    name: str
    told: Told | None
    """None: sound safety may let the run go on, too"""
    drives: Callable[[DrivenArm, int], None] | None = None
    """of the arm and a joint's number, once, when it breaks"""
    reading: Callable[[RobotState, RobotState, int], object] | None = None
    """of a reading, the last before the fault and a joint's number"""
    image: Callable[[CameraImage, CameraImage], CameraImage | None] | None = None
    """of a frame and the last before the fault"""
    points: Callable[[FloatArray, FloatArray, np.random.Generator], FloatArray] | None = None
    """of the points (n, 2) in a frame and those in the last before the fault; NaN: lost"""
    lost: tuple[str, ...] = ()
    """the robot's methods that raise from then on"""
    nudge: float = 0.0
    """by so much the target moves away then, within `NUDGED_IN` [m]"""


class FaultyArm:
    """A robot that breaks: what passes through it after ``fault_time`` is what the fault makes of it."""

    def __init__(self, robot: DrivenArm, fault: Fault | None, fault_time: float, joint: int) -> None:
        self.robot, self.fault, self.fault_time, self.joint = robot, fault, fault_time, joint
        self.readings: list[tuple[float, RobotState]] = []
        self._state, self._image = robot.read(), robot.image()
        self._broken = False

    @property
    def broken(self) -> bool:
        """Whether the fault is there."""
        return self.fault is not None and self.robot.time >= self.fault_time

    def advance(self, duration: float) -> None:
        """Let time pass [s]."""
        self.robot.advance(duration)
        if self.broken and not self._broken:
            self._broken = True
            if self.fault is not None and self.fault.drives is not None:
                self.fault.drives(self.robot, self.joint)

    def read(self) -> object:
        """Return what is read."""
        self._answer("read")
        state: object = self.robot.read()
        assert isinstance(state, RobotState)
        if not self.broken:
            self._state = state
        elif self.fault is not None and self.fault.reading is not None:
            state = self.fault.reading(state, self._state, self.joint)
        if isinstance(state, RobotState):
            self.readings.append((self.robot.time, state))
        return state

    def image(self) -> CameraImage | None:
        """Return what is delivered."""
        self._answer("image")
        image = self.robot.image()
        if not self.broken:
            self._image = image
        elif self.fault is not None and self.fault.image is not None and image and self._image:
            return self.fault.image(image, self._image)
        return image

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Pass on."""
        self._answer("command")
        self.robot.command(joint_velocities)

    def stop(self) -> None:
        """Pass on."""
        self._answer("command")
        self.robot.stop()

    def close(self) -> None:
        """Nothing is open."""

    def _answer(self, name: str) -> None:
        if self.broken and self.fault is not None and name in self.fault.lost:
            raise ConnectionError(f"{name}: the line is down")


def _gain(value: float, *, all_joints: bool = False) -> Callable[[DrivenArm, int], None]:
    def change(robot: DrivenArm, joint: int) -> None:
        robot.own_gain[slice(None) if all_joints else joint] = value

    return change


def _drift(robot: DrivenArm, joint: int) -> None:
    robot.own_drift[joint] = 0.1


def _with(positions: FloatArray, joint: int, value: float) -> FloatArray:
    changed = positions.copy()
    changed[joint] = value
    return changed


def _seconds(by: float) -> Callable[[RobotState, RobotState, int], object]:
    return lambda s, last, j: replace(s, time=s.time + by)


def _stamped(by: float) -> Callable[[CameraImage, CameraImage], CameraImage]:
    return lambda image, last: replace(image, time=image.time + by)


def _part(share: float, by: tuple[float, float]) -> Callable[..., FloatArray]:
    def move(pixels: FloatArray, last: FloatArray, random: np.random.Generator) -> FloatArray:
        del last, random
        return pixels + np.where(np.arange(len(pixels))[:, None] < share * len(pixels), by, 0.0)

    return move


def _row(value: float) -> Callable[..., FloatArray]:
    def put(pixels: FloatArray, last: FloatArray, random: np.random.Generator) -> FloatArray:
        del last, random
        changed = pixels.copy()
        changed[1] = value
        return changed

    return put


def _frozen(noise: float) -> Callable[..., FloatArray]:
    return lambda p, last, random: last + noise * random.standard_normal(p.shape)


def _camera(**changed: float) -> Callable[[DrivenArm, int], None]:
    def change(robot: DrivenArm, joint: int) -> None:
        del joint
        robot.drives = replace(robot.drives, **changed)

    return change


def _now_and_then(share: float, change: Callable[..., FloatArray]) -> Callable[..., FloatArray]:
    """Return the change in so many of the images."""
    return lambda p, last, random: change(p, last, random) if random.random() < share else p


def _anywhere(pixels: FloatArray, last: FloatArray, random: np.random.Generator) -> FloatArray:
    """Return points anywhere between those that were seen before the fault, and half as far beyond."""
    low, high = np.nanmin(last, axis=0), np.nanmax(last, axis=0)
    return random.uniform(1.5 * low - 0.5 * high, 1.5 * high - 0.5 * low, pixels.shape)


def _false(share: float) -> Callable[..., FloatArray]:
    """Return points of which so many, others in each image, are anywhere."""

    def put(pixels: FloatArray, last: FloatArray, random: np.random.Generator) -> FloatArray:
        wrong = random.random(len(pixels)) < share
        return np.where(wrong[:, None], _anywhere(pixels, last, random), pixels)

    return put


def _occluded(share: float) -> Callable[..., FloatArray]:
    def hide(pixels: FloatArray, last: FloatArray, random: np.random.Generator) -> FloatArray:
        del last, random
        return np.where(np.arange(len(pixels))[:, None] < share * len(pixels), np.nan, pixels)

    return hide


FAULTS = (
    Fault("dead joint", "joints", drives=_gain(0.0)),
    Fault("joint at half speed", "joints", drives=_gain(0.5)),
    Fault("joint at double speed", "joints", drives=_gain(2.0)),
    Fault("reversed joint", "joints", drives=_gain(-1.0)),
    Fault("joint drifts by 0.1 rad/s", "joints", drives=_drift),
    Fault("arm ignores commands", "joints", drives=_gain(0.0, all_joints=True)),
    Fault(
        "frozen joint readings, clock runs", "joints", reading=lambda s, last, j: replace(last, time=s.time)
    ),
    Fault(
        "one joint's reading frozen",
        "joints",
        reading=lambda s, last, j: replace(
            s, joint_positions=_with(s.joint_positions, j, last.joint_positions[j])
        ),
    ),
    Fault(
        "one joint's reading jumps by 5°",
        "joints",
        reading=lambda s, last, j: replace(
            s, joint_positions=_with(s.joint_positions, j, s.joint_positions[j] + math.radians(5.0))
        ),
    ),
    Fault(
        "NaN joint",
        "at once",
        reading=lambda s, last, j: replace(s, joint_positions=_with(s.joint_positions, j, math.nan)),
    ),
    Fault(
        "infinite joint",
        "at once",
        reading=lambda s, last, j: replace(s, joint_positions=_with(s.joint_positions, j, math.inf)),
    ),
    Fault(
        "NaN joint speed",
        "at once",
        reading=lambda s, last, j: replace(s, joint_velocities=_with(s.joint_velocities, j, math.nan)),
    ),
    Fault(
        "a joint missing",
        "at once",
        reading=lambda s, last, j: RobotState(s.time, s.joint_positions[:-1], s.joint_velocities[:-1]),
    ),
    Fault("no state", "at once", reading=lambda s, last, j: None),
    Fault("NaN clock", "at once", reading=_seconds(math.nan)),
    Fault("frozen clock", "at once", reading=lambda s, last, j: replace(s, time=last.time)),
    Fault("clock back 0.05 s", "at once", reading=_seconds(-0.05)),
    Fault("clock back 0.2 s", "at once", reading=_seconds(-0.2)),
    Fault("clock back 1 s", "at once", reading=_seconds(-1.0)),
    Fault("clock forward 1 s", "at once", reading=_seconds(1.0)),
    Fault("robot's read fails", "at once", lost=("read",)),
    Fault("robot's command fails", "at once", lost=("command",)),
    Fault("robot's image fails", "at once", lost=("image",)),
    Fault("robot gone", "at once", lost=("read", "image", "command")),
    Fault("no image", "image age", image=lambda image, last: None),
    Fault("frozen image", "image age", image=lambda image, last: last),
    Fault("NaN time stamps", "at once", image=_stamped(math.nan)),
    Fault("time stamps 1 s in the future", "at once", image=_stamped(1.0)),
    Fault("frozen points, new stamps", "points", points=_frozen(0.0)),
    Fault("frozen points, new stamps, noise", "points", points=_frozen(0.5)),
    Fault("half of the points off by (15, 10) px", "points", points=_part(0.5, (15.0, 10.0))),
    Fault("all points off by 20 px", "points", points=_part(1.0, (20.0, 0.0))),
    Fault("all points off by (-14, 14) px", "points", points=_part(1.0, (-14.0, 14.0))),
    Fault("points swapped", "points", points=lambda p, last, random: p[::-1]),
    Fault("NaN in a valid row", "at once", points=_row(math.nan)),
    Fault("infinity in a valid row", "at once", points=_row(math.inf)),
    Fault(
        "points lost",
        "at once",
        points=lambda p, last, random: np.where(np.arange(len(p))[:, None] < 3, p, np.nan),
    ),
)
"""A joint is the one that the plan turns fastest at the time of the fault."""

BORNE = (
    Fault("40% of the images dropped", None, drives=_camera(drop=0.4)),
    Fault("images 0.1 s later", None, drives=_camera(image_late=0.12)),
    Fault("images 0.2 s later", None, drives=_camera(image_late=0.22)),
    Fault("an old image again, 30%", None, points=_now_and_then(0.3, lambda p, last, random: last)),
    Fault("corrupted images, 10%", None, points=_now_and_then(0.1, _anywhere)),
    Fault("corrupted images, 50%", None, points=_now_and_then(0.5, _anywhere)),
    Fault("corrupted images", None, points=_anywhere),
    Fault("half of the points occluded", None, points=_occluded(0.5)),
    Fault("all points occluded", None, points=_occluded(1.0)),
    Fault("20% false features", None, points=_false(0.2)),
    Fault("50% false features", None, points=_false(0.5)),
    Fault("a false feature that stays, 40 px off", None, points=_part(0.1, (32.0, 24.0))),
    Fault("target nudged by 5 mm", None, nudge=0.005),
    Fault("target nudged by 30 mm", None, nudge=0.03),
    Fault("target nudged by 100 mm", None, nudge=0.1),
    Fault("all NaN", "at once", points=lambda p, last, random: np.full_like(p, np.nan)),
    Fault("NaN in a valid row, 20% of the images", "at once", points=_now_and_then(0.2, _row(math.nan))),
)
"""What a run may get through, or not."""


def marked_valid(fault: Fault | None, pixels: FloatArray, seen: BoolArray) -> BoolArray:
    """Return which points the features call valid: those of a broken row, too, if that is the fault."""
    if fault is not None and "valid row" in fault.name:
        return seen
    finite: BoolArray = seen & np.isfinite(pixels).all(axis=1)
    return finite
