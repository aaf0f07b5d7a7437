"""Faults while an arm moves: is every one a named stop in time, and does anything come too close?

Run: ``python -m benchmarks.motion_faults [--tasks 11] [--arm NAME] [--fault WORDS]``. Tasks are those of
`tests.whole_arm.arm_scenes`, planned with 10 mm more than the 10 mm that are asked to the balls and 2 mm more
than the 1 mm that is asked of the arm's own parts, away from joint limits and singular postures, such that
the plan comes within 30 mm of that and two undisturbed runs reach the goal within what is asked, and followed
on projected pixels with 0.5 px of noise by drives with lag and acceleration limits
(`benchmarks.driven_arm`). A fault (`benchmarks.planted_faults`) is planted at a
random 25 to 60% of the time; of joints, it is the one that turns fastest then. Judged are MuJoCo's distances
of all bodies every 5 ms, to where the arm stands still, and the time from the moment from which a fault can
be told to the beginning of braking:

- at once: the first reading, call or image that is broken;
- image age: when the newest image is as old as that of a sound robot may be, 0.25 s after the fault;
- joints: when the joints read have turned, since the fault, otherwise than every drive with a lag up to
  0.25 s and a gain of 0.7 to 1.6 would have turned them, by more than 3e-3 rad;
- points: the first image in which more than a quarter of the points, three or more, moved since the fault
  otherwise than they should have, by more than 4 px and 0.4 of that, also if time stamps may be up to 0.25 s
  ahead of what the image shows.

Beside them sound robots of many kinds, which must not be stopped.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from benchmarks.arm_runs import JOINT_SHARE, LEAST_DURATION, TOLERANCE_PX, Gaps, Truth
from benchmarks.driven_arm import FRAME, DrivenArm, Drives
from benchmarks.planted_faults import FAULTS, NUDGED_IN, Fault, FaultyArm, marked_valid
from scipy.spatial.transform import RigidTransform
from tests.whole_arm.arm_scenes import random_task

from omniservo.errors import ServoStop
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.planning import Plan
from omniservo.robots import Arm, load_arm
from omniservo.safety import SafetyOptions, Supervisor, VisibilityFilter, servo
from omniservo.servoing import EvenPaceLaw, PathLimits, RestToRestLaw
from omniservo.tracking import PathTracker, TrackerOptions
from omniservo.whole_arm import plan_with_arm

SEED = 24
ASKED, ROOM = 0.01, 0.01
SELF_ASKED, SELF_ROOM = 0.001, 0.002  # a UR5e's own links stand 3.5 mm apart at best
"""[m]"""

LIMIT_RESERVE, SINGULAR_VALUE = np.radians(5.0), 0.04
"""Plans keep so much, that the supervisor's own limits stop no sound run [rad, 1]."""

NEAR = 0.03
"""Of a task taken, the plan comes as near to what is asked [m]."""

SETTLING = 2.0
OPTIONS = SafetyOptions()
IN_TIME = 0.3
"""[s]"""

UNNAMED = ("", "time_limit")
"""ends that tell no fault"""

ARMS = ("rx60", "ur5e", "panda")


@dataclass(frozen=True)
class Sound:
    """A robot on which nothing is broken."""

    name: str
    drives: Drives = field(default_factory=Drives)
    noise_px: float = 0.5
    structure: float = 0.0
    """σ of the share by which the points' distances are wrong"""
    mount: tuple[float, float] = (0.0, 0.0)
    """by which the camera's mount is wrong [m, rad]"""


SOUND = (
    Sound("undisturbed"),
    *(Sound(f"gain {g}", Drives(gain=g)) for g in (0.8, 1.2, 1.5)),
    Sound("drives with a lag of 0.1 s", Drives(lag=0.1)),
    Sound("half of the stated acceleration", Drives(acceleration=0.5)),
    Sound("readings 0.2 s late", Drives(reading_late=0.2)),
    Sound("readings 0.2 s late, stamped so", Drives(reading_late=0.2, stamped_then=True)),
    Sound("readings with 3e-4 rad of noise", Drives(reading_noise=3e-4)),
    Sound("images 0.2 s late", Drives(image_late=0.2)),
    Sound("time stamps 0.1 s late", Drives(stamp_error=-0.1)),
    Sound("time stamps 0.2 s in the future", Drives(stamp_error=0.2)),
    Sound("time stamps off by up to 5 ms", Drives(stamp_jitter=5e-3)),
    Sound("one image of five lost", Drives(drop=0.2)),
    Sound("noise of 1 px", noise_px=1.0),
    Sound("distances wrong by 3%", structure=0.03),
    Sound("mount wrong by 5 mm, 1°", mount=(0.005, np.radians(1.0))),
)


class JointCurve(Protocol):
    """Joints along a plan."""

    def __call__(self, w: float, order: int = 0) -> FloatArray:
        """Return the joints (n,) at w, or a derivative of them."""
        ...


class PostureGaps(Protocol):
    """Distances of postures to what is around."""

    def least(self, joints: FloatArray) -> float:
        """Return the least of postures (m, n) [m]."""
        ...


@dataclass(frozen=True, eq=False)
class Job:
    """A planned task."""

    truth: Truth
    plan: Plan
    branch: JointCurve
    law: RestToRestLaw | EvenPaceLaw

    @property
    def goal(self) -> RigidTransform:
        """Where the goal image is taken, in the initial camera frame."""
        return self.plan.problem.initial_T_goal

    @property
    def room(self) -> float:
        """What the plan keeps to everything around [m]."""
        return ASKED + ROOM

    def gaps(self, asked: float, self_asked: float) -> PostureGaps:
        """Return what measures how much postures leave beyond what is asked [m]."""
        return Gaps(self.truth, asked, self_asked)


@dataclass(eq=False)
class Points:
    """The target's true projections with noise, and what the fault makes of them."""

    robot: FaultyArm
    truth: Truth
    noise_px: float
    random: np.random.Generator
    nudged_to: FloatArray = field(default_factory=lambda: np.zeros(3))
    """where a nudge leads the points, by a distance of 1"""
    off: list[tuple[float, bool]] = field(default_factory=list)
    """time and whether more than a quarter of the points are off, of each image since the fault"""
    _before: FloatArray | None = None
    _frame_before: int = 0

    def update(self, image: ByteArray, predicted: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return where the newest frame shows the points."""
        del image, predicted
        newest = self.robot.robot.exposed()
        assert newest is not None
        pixels, seen = self._true(newest[0])
        seen = seen & self.truth.camera.in_image(np.where(seen[:, None], pixels, 0.0))
        noisy = pixels + self.noise_px * self.random.standard_normal(pixels.shape)
        seen = seen & self.truth.camera.unproject(np.where(seen[:, None], noisy, 0.0))[1]
        fault = self.robot.fault
        if not self.robot.broken or self._before is None:
            self._before, self._frame_before = noisy, newest[0]
        elif fault is not None and fault.points is not None:
            noisy = fault.points(noisy, self._before, self.random)
            self.off.append((self.robot.robot.time, self._is_off(noisy - self._before, newest[0])))
        valid = marked_valid(fault if self.robot.broken else None, noisy, seen)
        return np.where(valid[:, None], noisy, np.nan), valid

    def _true(self, frame: float) -> tuple[FloatArray, BoolArray]:
        """Return where the points are in a frame, (n, 2) [px], and which of them have a projection."""
        pose = self.truth.initial_T_camera(self.robot.robot.joints_at(frame)[None])
        return self.truth.camera.project(pose[0].inv().apply(self.truth.points + self.nudged(frame * FRAME)))

    def nudged(self, time: float) -> FloatArray:
        """Return by how much the target moved until then (3,) [m]."""
        fault, since = self.robot.fault, time - self.robot.fault_time
        distance = 0.0 if fault is None else fault.nudge * float(np.clip(since / NUDGED_IN, 0.0, 1.0))
        return distance * self.nudged_to

    def _is_off(self, moved: FloatArray, frame: int) -> bool:
        """Whether the points did not move, since the fault, as the camera did, however late the image is."""
        for late in np.linspace(0.0, OPTIONS.time_offset / FRAME, 11):
            should = self._true(frame - late)[0] - self._true(self._frame_before - late)[0]
            bound = OPTIONS.image_error + OPTIONS.structure_error * np.linalg.norm(should, axis=1)
            bad = np.linalg.norm(moved - should, axis=1) > bound
            if int(bad.sum()) <= max(2, len(bad) // 4):
                return False
        return True


class Timed(Supervisor):
    """A supervisor that notes when, by the true ``clock`` [s], it first begins to brake for a reason."""

    def __init__(
        self,
        clock: Callable[[], float],
        robot: FaultyArm,
        arm: Arm,
        mount: RigidTransform,
        options: SafetyOptions,
    ) -> None:
        self._clock, self.began = clock, np.inf
        super().__init__(robot, arm, mount, camera=robot, wait=robot.advance, options=options)  # type: ignore[arg-type]

    def stop(self, reason: ServoStop | None = None) -> None:
        """As `Supervisor.stop`."""
        if reason is not None and self.began == np.inf:
            self.began = self._clock()
        super().stop(reason)


@dataclass(frozen=True)
class Outcome:
    """What became of one run."""

    reason: str
    """"" where the goal was reached, "time_limit" where it was not, nor anything told"""
    delay: float
    """from the moment from which the fault can be told to the beginning of braking [s], 0 where that began
    earlier; infinite: it was told never; NaN: nor could it be"""
    left: float
    """beyond the clearance, least of all pairs [m]"""
    distance: float
    """least of all pairs [m]"""
    finite: bool = True
    """every command that was sent is finite"""
    goal_px: float = np.nan
    """rms distance of the true points, where they are at the end, to the goal image [px]; NaN: not all are
    seen"""


def jobs(arm: Arm, count: int) -> Iterator[Job]:
    """Yield planned tasks."""
    random = np.random.default_rng(SEED)
    while count:
        problem, setting = random_task(arm, random)
        if setting.start is None:
            continue
        wider = replace(
            setting,
            clearance=ASKED + ROOM,
            self_clearance=SELF_ASKED + SELF_ROOM,
            limit_reserve=LIMIT_RESERVE,
            singular_value=SINGULAR_VALUE,
        )
        found = plan_with_arm(replace(problem, visibility_margin=8.0), wider)
        if not found.certified or found.branch is None:
            continue
        balls = [(np.array(o.center), o.radius) for o in problem.obstacles]
        truth = Truth(arm, setting.start, setting.flange_T_camera, problem.camera, problem.points, balls)
        planned = Gaps(truth, ASKED, SELF_ASKED).least(found.branch(np.linspace(0.0, 1.0, 101)))
        if planned > NEAR:
            continue
        limits = PathLimits(found.branch, JOINT_SHARE * arm.joint_speed, JOINT_SHARE * arm.joint_acceleration)
        law = RestToRestLaw.for_limits(limits, least_duration=LEAST_DURATION)
        job = Job(truth, found.plan, found.branch, law)
        undisturbed = [outcome(job, SOUND[0], None, (100_000 + k,)) for k in range(2)]
        if all(not o.reason and o.left > 0.0 for o in undisturbed):
            count -= 1
            yield job


def outcome(
    job: Job, sound: Sound, fault: Fault | None, seed: tuple[int, ...], safety: SafetyOptions = OPTIONS
) -> Outcome:
    """Return what becomes of a run."""
    random = np.random.default_rng([SEED, *seed])
    fault_time = float(random.uniform(0.25, 0.6)) * job.law.duration
    w, speed = job.law(fault_time)
    joint = int(np.argmax(np.abs(job.branch(w, 1) * speed)))
    truth, mount = _truth(job, sound, random)
    robot = DrivenArm(truth.arm, truth.start, sound.drives, random)
    faulty = FaultyArm(robot, fault, fault_time, joint)
    points = Points(faulty, truth, sound.noise_px, random)
    if fault is not None and fault.nudge:
        way = random.normal(size=3)
        points.nudged_to = way / np.linalg.norm(way)
    goal, _ = truth.camera.project(job.goal.inv().apply(truth.points))
    options = TrackerOptions(delay=sound.drives.image_late + 0.5 / 30.0, tolerance_px=TOLERANCE_PX)
    tracker = PathTracker(job.plan, truth.camera, goal_pixels=goal, options=options, time_law=job.law)
    supervisor = Timed(lambda: robot.time, faulty, truth.arm, mount, safety)

    def posture(time: float) -> tuple[FloatArray, FloatArray]:
        w, speed = job.law(time)
        return job.branch(w), job.branch(w, 1) * speed

    stop = servo(
        supervisor, tracker, points, VisibilityFilter(truth.camera, delay=sound.drives.image_late),
        on_step=lambda step: None, time_limit=job.law.duration + SETTLING, posture=posture,
    )  # fmt: skip
    robot.advance(0.3)
    moment = _moment(faulty, points) if fault is not None else np.nan
    trace = np.array(robot.trace)[::5]
    left = job.gaps(ASKED, SELF_ASKED).least(trace)
    distance = left + ASKED if left > 0.0 else job.gaps(0.0, 0.0).least(trace)
    reason = "" if stop is None else stop.reason
    began = supervisor.began if reason not in UNNAMED else np.inf
    delay = max(began - moment, 0.0) if min(began, moment) < np.inf else np.nan
    finite = all(np.isfinite(sent).all() for _, sent in robot.commands)
    seen = truth.camera.project(
        truth.initial_T_camera(trace[-1:])[0].inv().apply(truth.points + points.nudged(robot.time))
    )[0]
    goal_px = float(np.sqrt(np.square(seen - goal).sum(axis=1).mean()))
    return Outcome(reason, delay, left, distance, finite, goal_px)


def _truth(job: Job, sound: Sound, random: np.random.Generator) -> tuple[Truth, RigidTransform]:
    """Return what is there, and the mount that the robot believes in."""
    truth = job.truth
    share = 1.0 + sound.structure * random.standard_normal(len(truth.points))
    way, turn = (random.normal(size=3) for _ in range(2))
    error = RigidTransform.from_exp_coords(
        np.concatenate(
            [
                turn / np.linalg.norm(turn) * sound.mount[1],
                way / np.linalg.norm(way) * sound.mount[0],
            ]
        )
    )
    return replace(truth, points=truth.points * share[:, None]), truth.flange_T_camera * error


def _moment(faulty: FaultyArm, points: Points) -> float:
    """Return from when the fault can be told [s]; infinity where it never can."""
    fault, since = faulty.fault, faulty.fault_time
    assert fault is not None
    if fault.told is None:
        return np.inf
    if fault.told == "at once":
        return since
    if fault.told == "image age":
        return since + OPTIONS.image_age
    if fault.told == "points":
        return next((time for time, off in points.off if off), np.inf)
    return _joints_moment(faulty)


def _joints_moment(faulty: FaultyArm) -> float:
    """Return when the joints read have moved, since the fault, as no drive within the bounds moves them."""
    times = np.array([time for time, _ in faulty.robot.commands])
    velocities = np.array([u for _, u in faulty.robot.commands])
    steps = velocities[:-1] * np.diff(times)[:, None]
    sent = np.vstack([np.zeros(steps.shape[1]), np.cumsum(steps, axis=0)])
    lags = np.linspace(0.0, OPTIONS.drive_lag, 26)

    def sent_at(time: float) -> FloatArray:
        return np.array([np.interp(time - lags, times, column) for column in sent.T])

    before, first = sent_at(faulty.fault_time), None
    for time, state in faulty.readings:
        if time < faulty.fault_time:
            first = state.joint_positions
            continue
        if first is None:
            return faulty.fault_time
        told = sent_at(time) - before
        bounds = np.stack([OPTIONS.least_gain * told, OPTIONS.most_gain * told])
        low, high = bounds.min(axis=(0, 2)), bounds.max(axis=(0, 2))
        moved = state.joint_positions - first
        if (np.maximum(low - moved, moved - high) > OPTIONS.following_error).any():
            return time
    return np.inf


def faults_row(fault: Fault, found: list[Outcome]) -> str:
    """Say what became of a fault's runs."""
    delays = np.array([o.delay for o in found if not np.isnan(o.delay)])
    late = int((delays > IN_TIME).sum())
    reasons = Counter(o.reason or "reached the goal" for o in found)
    words = ", ".join(f"{reason} {n}" for reason, n in reasons.most_common())
    times = f"{np.median(delays):.2f} / {delays.max():.2f}" if len(delays) else "–"
    return (
        f"| {fault.name} | {fault.told} | {len(found)} | {words} | {len(found) - len(delays)} | {times} |"
        f" {late} | {1e3 * min(o.left for o in found):.1f} | {sum(o.left < 0.0 for o in found)} |"
        f" {sum(o.distance <= 0.0 for o in found)} |"
    )


def main() -> None:
    """Run everything and print two tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--tasks", type=int, default=11, help="of each arm")
    parser.add_argument("--arm", choices=ARMS, action="append")
    parser.add_argument("--fault", default="", help="only those whose name holds these words")
    asked = parser.parse_args()
    planned = {
        (ARMS.index(name), k): job
        for name in asked.arm or ARMS
        for k, job in enumerate(jobs(load_arm(name), asked.tasks))
    }
    head = (
        "| fault | told | runs | ended | cannot be told | s until braking, median / most | later than 0.3 s |"
        " least left of the clearance [mm] | below it | contacts |"
    )
    print(head, "|---" * (head.count("|") - 1) + "|", sep="\n", flush=True)
    for number, fault in enumerate(FAULTS):
        if asked.fault not in fault.name:
            continue
        found = [outcome(job, SOUND[0], fault, (*place, number)) for place, job in planned.items()]
        print(faults_row(fault, found), flush=True)
    head = "| sound robot | runs | stopped | at the goal | least left of the clearance [mm] |"
    print("", head, "|---" * (head.count("|") - 1) + "|", sep="\n", flush=True)
    for sound in (s for s in SOUND if asked.fault in s.name):
        found = [outcome(job, sound, None, place) for place, job in planned.items()]
        stops = Counter(o.reason for o in found if o.reason not in UNNAMED)
        at_goal = sum(not o.reason for o in found)
        words = ", ".join(f"{reason} {n}" for reason, n in stops.items()) or "0"
        left = 1e3 * min(o.left for o in found)
        print(
            f"| {sound.name} | {len(found)} | {words} | {at_goal} | {left:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
