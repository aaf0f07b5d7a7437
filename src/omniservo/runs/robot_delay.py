"""How late a robot's images and motions are: two joints swing while camera and joints are recorded."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.camera_delay import CameraDelay, DelayViews, camera_delay
from omniservo.errors import NoSolutionError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.hardware import JointHistory
from omniservo.robots import Arm, ArmBodies, RobotState, arm_clearance
from omniservo.robots.path_following.joint_segment import joint_segment
from omniservo.runs.moved_joint import moved_joint
from omniservo.runs.robot_cell import RobotCell
from omniservo.runs.supervisor_of import supervisor_of
from omniservo.safety import SafetyOptions, SupervisedRobot

SECONDS = 4.0
"""that the joints swing"""

FREQUENCIES = (0.75, 1.25)
"""of the two joints [Hz]: whole swings in `SECONDS`, so that both end where they began"""

AMPLITUDE = math.radians(2.0)
"""of a joint, where its limits allow it [rad]"""

LIMITS_USED = 0.5
"""share of the joints' speeds and accelerations that the swing takes"""

_PERIOD = 5e-3
_POINTS = 60
_WINDOW = (21, 21)
_BACK_AND_FORTH = 0.7
"""A point that is tracked back lands this near to where it began, or is lost [px]."""

_LINES = 9

MOST_LAG = 0.3
"""Actuation lags are searched up to this [s]."""


@with_field_docs
@dataclass(frozen=True)
class RobotDelay:
    """What was found."""

    camera: CameraDelay
    actuation_lag: float
    """joints turn as they were commanded so long before [s]"""
    actuation_sigma: float
    """standard deviation of that [s]"""
    images: int
    """how many were used"""
    image_age: float
    """from their stamps until they came [s]; 99% came sooner"""


def swing_joints(arm: Arm) -> tuple[int, int]:
    """Return the two joints that swing: of the last three, those that turn the camera's view most."""
    return arm.dof - 3, arm.dof - 2


def measure_delay(cell: RobotCell, options: SafetyOptions) -> RobotDelay:
    """Swing two joints for four seconds, and find how late images and motions are.

    The camera must see a static scene with natural features. The arm ends where it began.

    Args:
        cell: the robot.
        options: of its supervisor; time offsets are searched within their ``time_offset``.

    Raises:
        NoSolutionError: see `camera_delay` and `actuation_lag`; or the arm may not move,
            has no room to, or was moved since that was proven.
        ServoStop: what stopped the arm.
    """
    arm = cell.scene.arm
    chosen, size = swing_joints(arm), swing_size(arm)
    begin = cell.driver.read().joint_positions
    if why := swing_barred(arm, cell.scene.flange_T_camera, begin):
        raise NoSolutionError(
            f"{arm.joint_names[chosen[0]]} and {arm.joint_names[chosen[1]]} have no {math.degrees(size):.1f} "
            f"deg of room either way: {why}; bring the arm elsewhere"
        )
    cell.approve(
        f"swing {arm.joint_names[chosen[0]]} and {arm.joint_names[chosen[1]]} by {math.degrees(size):.1f} "
        f"deg either way for {SECONDS:g} s"
    )
    if words := moved_joint(arm, begin, cell.driver.read().joint_positions):
        raise NoSolutionError(
            f"{words} since its room was proven; nothing was commanded: start again from where it now stands"
        )
    recorded = _recorded(cell, options, chosen, size)
    tracks = tracked(recorded.images)
    time_sigma = float(np.median(recorded.time_sigmas))
    views = DelayViews(np.array(recorded.stamps), tracks, recorded.history, time_sigma)
    found = camera_delay(cell.scene.camera, arm, cell.scene.flange_T_camera, views)
    lag, sigma = actuation_lag(recorded, chosen)
    return RobotDelay(found, lag, sigma, len(tracks), float(np.quantile(recorded.ages, 0.99)))


@dataclass
class DelayRecording:
    """What came in while the joints swung."""

    history: JointHistory
    states: list[RobotState]
    sent: list[tuple[float, FloatArray]]
    stamps: list[float]
    time_sigmas: list[float]
    """of the stamps, see `CameraImage` [s]"""
    images: list[ByteArray]
    ages: list[float]
    """from the stamps until the images came [s]"""


def swing_size(arm: Arm) -> float:
    """Return how far the joints swing, so that speeds and accelerations keep their limits [rad]."""
    rows = list(swing_joints(arm))
    fastest = 2.0 * math.pi * max(FREQUENCIES)
    speed, acceleration = arm.joint_speed[rows].min(), arm.joint_acceleration[rows].min()
    return float(min(AMPLITUDE, LIMITS_USED * speed / fastest, LIMITS_USED * acceleration / fastest**2))


def swing_barred(arm: Arm, flange_T_camera: RigidTransform, joints: FloatArray) -> str:
    """Return why an arm that stands in ``joints`` (n,) [rad] has no room to swing; "" where it has.

    Proven are `_LINES` motions of the first joint over its swing, the second at rest evenly over its own:
    between them it is a quarter of a degree off at most, 1 mm at 0.23 m from its axis, of the 2 mm kept.
    """
    bodies, (first, second), size = ArmBodies(arm), swing_joints(arm), swing_size(arm)
    for aside in np.linspace(-size, size, _LINES):
        ends = np.array([joints, joints])
        ends[:, first] += np.array([-size, size])
        ends[:, second] += aside
        if not all(arm.within_limits(end) for end in ends):
            return "a joint would leave the arm file's range"
        found = arm_clearance(bodies, joint_segment(arm, ends[0], ends[1], flange_T_camera), clearance=0.0)
        if found.reason:
            return found.reason
    return ""


def _recorded(
    cell: RobotCell, options: SafetyOptions, chosen: tuple[int, int], size: float
) -> DelayRecording:
    """Swing the joints, and return what came in; the arm stands still on return."""
    supervisor = supervisor_of(cell, options)
    begin = supervisor.read()
    found = DelayRecording(JointHistory(len(begin.joint_positions), 2.0 * SECONDS), [], [], [], [], [], [])
    try:
        while (passed := supervisor.read().time - begin.time) < SECONDS:
            _take_in(found, supervisor)
            wanted, speeds = swing(begin.joint_positions, chosen, size, passed)
            speeds += 2.0 * (wanted - found.states[-1].joint_positions)
            supervisor.command(speeds)
            found.sent.append((supervisor.time, speeds))
            supervisor.wait(_PERIOD)
    finally:
        supervisor.stop()
    for _ in range(round(0.5 / _PERIOD)):  # images and readings that are under way
        supervisor.wait(_PERIOD)
        _take_in(found, supervisor)
    return found


def _take_in(found: DelayRecording, supervisor: SupervisedRobot) -> None:
    state, image = supervisor.read(), supervisor.image()
    found.states.append(state)
    found.history.add(state)
    if image is not None and (not found.stamps or image.time > found.stamps[-1]):
        found.stamps.append(image.time)
        found.ages.append(supervisor.time - image.time)
        found.time_sigmas.append(image.time_sigma)
        found.images.append(image.pixels)


def swing(
    begin: FloatArray, chosen: tuple[int, int], size: float, time: float
) -> tuple[FloatArray, FloatArray]:
    """Return the joints (n,) [rad] at ``time`` [s] of the swing, and their speeds [rad/s].

    q = sin²(π t/T) A sin(2π f t): at rest at both ends.
    """
    wanted, speeds = begin.copy(), np.zeros_like(begin)
    phase = math.pi * time / SECONDS
    for joint, frequency in zip(chosen, FREQUENCIES, strict=True):
        rate = 2.0 * math.pi * frequency
        wanted[joint] += size * math.sin(phase) ** 2 * math.sin(rate * time)
        speeds[joint] = size * (
            math.sin(phase) ** 2 * rate * math.cos(rate * time)
            + math.sin(2.0 * phase) * (math.pi / SECONDS) * math.sin(rate * time)
        )
    return wanted, speeds


def tracked(images: list[ByteArray]) -> FloatArray:
    """Return where points of the first image are in each (k, n, 2) [px]; NaN where they are lost.

    Points are corners; they are found in every image anew from the first (pyramidal Lucas–Kanade, OpenCV),
    beginning where the image before had them, and checked by the way back.

    Raises:
        NoSolutionError: fewer than three images, or no corners.
    """
    if len(images) < 3:
        raise NoSolutionError(f"{len(images)} images came in {SECONDS:g} s; at least 3 are needed")
    first = images[0]
    corners = cv2.goodFeaturesToTrack(first, _POINTS, 0.01, 15)
    if corners is None:
        raise NoSolutionError("the first image has no corners: show the camera a scene with some texture")
    tracks, guess = [corners[:, 0].astype(np.float64)], corners.copy()
    flags = cv2.OPTFLOW_USE_INITIAL_FLOW
    for image in images[1:]:
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            first, image, corners, guess.copy(), winSize=_WINDOW, maxLevel=3, flags=flags
        )
        back, again, _ = cv2.calcOpticalFlowPyrLK(
            image, first, found, corners.copy(), winSize=_WINDOW, maxLevel=3, flags=flags
        )
        good = (status[:, 0] == 1) & (again[:, 0] == 1)
        good &= np.linalg.norm(back - corners, axis=2)[:, 0] < _BACK_AND_FORTH
        guess = np.where(good[:, None, None], found, guess)
        tracks.append(np.where(good[:, None], found[:, 0], np.nan))
    return np.array(tracks)


def actuation_lag(recorded: DelayRecording, chosen: tuple[int, int]) -> tuple[float, float]:
    """Return how long after a command its speeds are measured [s], and the standard deviation of that.

    Minimises Σ ‖q̇(t) − u(t − L)‖² over L, u the commands, each in force until the next: linear between the
    middles of these times.

    Raises:
        NoSolutionError: the joints follow later than `MOST_LAG`.
    """
    rows = list(chosen)
    times = np.array([state.time for state in recorded.states])
    times, first = np.unique(times, return_index=True)
    measured = np.array([recorded.states[i].joint_velocities[rows] for i in first])
    begun = np.array([time for time, _ in recorded.sent])
    sent_times = 0.5 * (begun[:-1] + begun[1:])
    sent = np.array([speeds[rows] for _, speeds in recorded.sent[:-1]])
    within = (times > sent_times[0] + MOST_LAG) & (times < sent_times[-1])
    lags = np.arange(0.0, MOST_LAG, 1e-3)
    costs = np.array([_off(times[within] - lag, measured[within], sent_times, sent) for lag in lags])
    best = int(np.argmin(costs))
    if best == len(lags) - 1:
        raise NoSolutionError(
            f"the joints turn {MOST_LAG:g} s or more after their commands, which no run can bear: a "
            "controller or driver that smooths or queues what it is sent"
        )
    if best == 0:
        return 0.0, float(lags[1])
    curve = np.polyfit(lags[best - 1 : best + 2] - lags[best], costs[best - 1 : best + 2], 2)
    lag = float(lags[best] - 0.5 * curve[1] / curve[0])
    variance = costs[best] / max(2 * int(within.sum()) - 1, 1)
    return lag, float(np.sqrt(variance / max(curve[0], 1e-12)))


def _off(times: FloatArray, measured: FloatArray, sent_times: FloatArray, sent: FloatArray) -> float:
    then = np.column_stack([np.interp(times, sent_times, column) for column in sent.T])
    return float(np.sum((measured - then) ** 2))
