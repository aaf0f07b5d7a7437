"""Whether a robot is fit to be moved: its clocks and rates, where it stands, and what stops it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from omniservo.errors import ServoStop
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.hardware import ArmConnection, ClockMap
from omniservo.robots import SELF_CLEARANCE, Arm, ArmBodies, ArmMode, CameraSource
from omniservo.runs.joint_trial import STILL, JointAnswer, JointTrial
from omniservo.runs.loop_delay import LoopDelay
from omniservo.runs.moved_joint import moved_joint
from omniservo.runs.on_robot import image_latency_of, out_of_range
from omniservo.runs.safety_of_task import FRAMES_MISSED, image_age_of
from omniservo.safety import SafetyOptions, refuse_unready
from omniservo.safety.blind_motion import BEGINS_BEFORE
from omniservo.tasks import RobotFile
from omniservo.tasks.robot_file import RobotCamera

SECONDS = 3.0
"""that states and images are listened to"""

SLOW = math.radians(1.0)
"""at which one joint moves for the proof of the watchdog [rad/s]"""

ALLOWED = 0.15
"""A joint must stand so long after the watchdog's time [s]."""

PATIENCE = 1.25
"""So long a joint may go on after the last command before this program stops it [s]: longer than the slowest
watchdog (1 s) and `ALLOWED`, and no farther than the joint trial found free"""

LEAST_JOINT_RATE = 50.0
"""[Hz]; slower states leave the supervisor blind for longer than its reaction"""

NEAR = 0.2
"""Gaps are measured up to this [m]."""

ENOUGH = 0.9
"""With this share of the robot file's `camera.rate` nothing is said: single images are lost on any line."""

_POLL = 5e-4


@with_field_docs
@dataclass(frozen=True)
class StreamTimes:
    """How states or images came in."""

    rate: float
    """[Hz]"""
    age_median: float
    """from the stamp to the arrival [s]; what every message needs at least is not seen where clocks differ"""
    age_p99: float
    """99% came sooner [s]"""
    jitter: float
    """standard deviation of the time between two arrivals [s]"""


@with_field_docs
@dataclass(frozen=True)
class LineClock:
    """How the clock of a sender lies to this machine's, with the least delay of its line in it."""

    offset: float
    """this machine's clock less the sender's [s]"""
    drift: float
    """how much faster this machine's clock runs [s/s]"""
    spread: float
    """nine tenths of the messages are no later than the least delay by more [s]"""
    later: float
    """all messages are by now so much later than at first [s]; 0: the line is as fast as it was"""


@with_field_docs
@dataclass(frozen=True)
class RobotCheck:
    """What was found."""

    joints: StreamTimes
    images: StreamTimes | None
    """None: none came"""
    arm_clock: LineClock | None
    """None: joint states have no stamps of another clock"""
    camera_clock: LineClock | None
    """None: images have none"""
    answers: tuple[JointAnswer, ...]
    """of the joints that were tried, the last one first"""
    self_clearance: float
    """smallest gap between parts of the arm, where it stands [m]"""
    stop_seconds: float | None
    """from the last command until the joint that moved stood [s]; None: not tried"""
    findings: tuple[str, ...]
    """what must be mended before the arm is moved; none: it is fit"""


def check_robot(
    robot: RobotFile,
    arm: Arm,
    connection: ArmConnection,
    camera: CameraSource,
    approve: Callable[[str], None],
    late: LoopDelay | None = None,
) -> RobotCheck:
    """Listen to a robot, try every joint, then move one at 1°/s, fall silent, and see it stop.

    Args:
        robot: its file.
        arm: as loaded of that.
        connection: to it; use it no more afterwards: the watchdog may have ended it.
        camera: on its flange.
        approve: called with what the arm is about to do; raises where it may not.
        late: how late its images were measured to be, by which ``camera`` corrects their stamps then; None:
            they were not.

    Raises:
        NoSolutionError: it may not move.
        ServoStop: the connection was lost, or data that are none.
    """
    joints, images = _listened(connection, camera)
    clocks = line_clock(connection), line_clock(camera)
    state = connection.read()
    findings = [
        *_findings(joints, images, robot.camera, late),
        *filter(None, [out_of_range(arm, state.joint_positions)]),
    ]
    if state.mode is not ArmMode.READY:
        findings.append(f"the arm is in {state.mode.replace('_', ' ')}")
    gap, parts = _self_clearance(arm, state.joint_positions)
    if gap < SELF_CLEARANCE:
        findings.append(f"{parts} are {1e3 * gap:.1f} mm apart: another arm file, or another zero?")
    stopped: float | None = None
    answers: tuple[JointAnswer, ...] = ()
    if not findings:
        trial = JointTrial(arm, connection, robot.arm.flange_T_camera.transform, robot.workspace)
        answers, findings = trial.run(approve)
    if not findings:
        promised = robot.watchdog if connection.watchdog is None else connection.watchdog
        stopped, findings = watchdog_proof(arm, connection, approve, promised or 0.0)
    return RobotCheck(joints, images, *clocks, answers, gap, stopped, tuple(findings))


def line_clock(source: object) -> LineClock | None:
    """Return what an arm's connection, or a camera, knows of its sender's clock; None where there is none."""
    clock = getattr(source, "clock", None)
    if not isinstance(clock, ClockMap) or math.isnan(clock.offset):
        return None
    return LineClock(clock.offset, clock.drift, clock.spread, clock.later)


def rate_notice(images: StreamTimes | None, rate: float) -> str | None:
    """Return what to say of images that come less often than the robot file counts on [Hz]; None: nothing."""
    if images is None or images.rate >= ENOUGH * rate:
        return None
    return (
        f"images come {images.rate:.1f} times a second; camera.rate of the robot file counts on {rate:g}: "
        "state what comes, or the arm will have to wait for images"
    )


def always_waits(images: StreamTimes, lens: RobotCamera, late: LoopDelay | None = None) -> str | None:
    """Return what to say of images of which the newest is too old before the next one comes; None: nothing.

    The arm slows down before each of them comes, and never gets on. ``late``: see `check_robot`.
    """
    latency = image_latency_of(lens, late)
    period, most = 1.0 / images.rate, image_age_of(lens.rate, latency)
    if images.age_median + period + BEGINS_BEFORE <= most:
        return None
    needed = images.age_p99 + period + BEGINS_BEFORE - latency
    return (
        f"images are {images.age_median:.3f} s old, {images.rate:.1f} come a second: before the next "
        f"one comes the newest is {images.age_median + period:.3f} s old, and the arm waits for images from "
        f"{most - BEGINS_BEFORE:.3f} s on; images that come sooner, or camera.rate: "
        f"{math.floor(10.0 * FRAMES_MISSED / needed) / 10.0:g} in the robot file, which lets them be older"
    )


def _findings(
    joints: StreamTimes, images: StreamTimes | None, lens: RobotCamera, late: LoopDelay | None
) -> list[str]:
    options, found = SafetyOptions(), []
    if joints.rate < LEAST_JOINT_RATE:
        found.append(f"joint states come {joints.rate:.0f} times a second; at least {LEAST_JOINT_RATE:g}")
    if joints.age_p99 > options.joint_age:
        found.append(
            f"1% of the joint states are {joints.age_p99:.3f} s old or more; at most {options.joint_age:g} s:"
            " a slow line, or a computer that is too busy"
        )
    if images is None:
        return [*found, "no images come"]
    most = image_age_of(lens.rate, image_latency_of(lens, late))
    if images.age_p99 > most:
        found.append(
            f"1% of the images are {images.age_p99:.3f} s old or more; at most {most:.3g} s: a "
            "slow line, or a camera or computer that is too busy"
        )
    return [*found, *filter(None, [always_waits(images, lens, late)])]


def _listened(connection: ArmConnection, camera: CameraSource) -> tuple[StreamTimes, StreamTimes | None]:
    """Return how states and images come in."""
    states: list[tuple[float, float]] = []
    frames: list[tuple[float, float]] = []
    end = time.monotonic() + SECONDS
    while (now := time.monotonic()) < end:
        stamp, image = connection.read().time, camera.image()
        if not states or stamp > states[-1][0]:
            states.append((stamp, now))
        if image is not None and (not frames or image.time > frames[-1][0]):
            frames.append((image.time, now))
        time.sleep(_POLL)
    found = _stream_times(states)
    if found is None:
        raise ServoStop(f"{len(states)} joint states came in {SECONDS:g} s")
    return found, _stream_times(frames)


def _stream_times(arrivals: list[tuple[float, float]]) -> StreamTimes | None:
    if len(arrivals) < 3:
        return None
    stamps, came = np.array(arrivals).T
    ages, steps = came - stamps, np.diff(came)
    return StreamTimes(
        rate=float(1.0 / np.mean(np.diff(stamps))),
        age_median=float(np.median(ages)),
        age_p99=float(np.quantile(ages, 0.99)),
        jitter=float(np.std(steps)),
    )


def _self_clearance(arm: Arm, joints: FloatArray) -> tuple[float, str]:
    """Return the smallest gap [m] between parts of the arm, of those nearer than `NEAR`, and which."""
    bodies = ArmBodies(arm)  # what it carries is not in its file
    bodies.place(joints)
    nearest = min(bodies.near(NEAR), key=lambda each: each.gap, default=None)
    return (NEAR, "") if nearest is None else (nearest.gap, " and ".join(bodies.names(nearest.pair)))


def watchdog_proof(
    arm: Arm, connection: ArmConnection, approve: Callable[[str], None], promised: float
) -> tuple[float | None, list[str]]:
    """Turn the last joint at 1°/s for half a second, fall silent, and see it stop.

    Args:
        arm: its kinematics and limits.
        connection: to it, standing still.
        approve: called with what the arm is about to do; raises where it may not.
        promised: after the last command the arm begins to stop [s].

    Returns:
        How long after the last command the joint stood [s], None where it did not move; what is wrong.
    """
    joint = arm.dof - 1
    name, standing = arm.joint_names[joint], connection.read().joint_positions
    before = standing[joint]
    sign = 1.0 if before < arm.joint_range[joint].mean() else -1.0
    approve(f"turn {name} at {math.degrees(SLOW):g} deg/s for half a second, then fall silent")
    if words := moved_joint(arm, standing, connection.read().joint_positions):
        return None, [f"{words} since its room was proven; check it again from where it now stands"]
    velocities = np.zeros(arm.dof)
    velocities[joint] = sign * SLOW
    last = begin = time.monotonic()
    try:
        while time.monotonic() < begin + 0.5:
            connection.command(velocities)
            last = time.monotonic()
            time.sleep(5e-3)
            refuse_unready(connection.read())
        if hasattr(connection, "fall_silent"):  # it has a thread that brakes, and would end with its process
            connection.fall_silent()
        moved = sign * (connection.read().joint_positions[joint] - before)
        if moved < 0.2 * SLOW * 0.5:
            return None, [f"{name} was sent by 0.5 deg and turned by {math.degrees(moved):.2f} deg"]
        stands = False
        while not stands and time.monotonic() < last + PATIENCE:
            time.sleep(1e-3)
            state = connection.read()
            stands = state.time > last and abs(state.joint_velocities[joint]) < STILL
        stood = time.monotonic() - last
    finally:
        connection.stop()
    if not stands or stood > promised + ALLOWED:
        return stood, [
            f"{name} went on for {stood:.2f} s after the last command; the watchdog promises {promised:g} s"
        ]
    return stood, []
