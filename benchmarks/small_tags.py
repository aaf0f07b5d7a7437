"""Following a plan by the four corners of one small tag: where runs end, and whether the stated pose holds.

Run: ``python -m benchmarks.small_tags [--count 40]``. A tag of 16 to 60 px, 0.5 to 0.8 m before a perspective
camera of 640 × 480 px, turned by some 2° or some 17°; a goal up to 0.2 m and some 20° away. Its corners are
projected with 0.1 or 0.3 px of noise, 30 images a second; a twist acts 20 ms after the exposure, and the
camera moves as told, which the joints measure. Structure and camera are known, so all of the error is the
pixels'. A run takes ten seconds, four of them on the path. Counted are the states of the pose filter that
have the truth within their 95% ellipsoid, and those more than 5 σ off (χ²₆ > 41): of the first three images,
and of the rest.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan, PlanningProblem, plan_path
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import PathTracker, TrackerOptions

CAMERA = UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480)
PERIOD, LATENCY, SECONDS, PATH_SECONDS = 1.0 / 30.0, 0.02, 10.0, 4.0
WITHIN, BEYOND = 12.59, 41.0
"""χ²₆ at 95%, and (6 numbers) at 5 σ"""


class Joints:
    """Where the camera was, as the joints measure it."""

    def __init__(self) -> None:
        self._times, self._poses = [0.0], [RigidTransform.identity()]

    @property
    def pose(self) -> RigidTransform:
        """Where it is."""
        return self._poses[-1]

    @property
    def until(self) -> float:
        """Up to now [s]."""
        return self._times[-1]

    def move(self, twist: FloatArray, seconds: float) -> None:
        """Move by a twist of the camera."""
        step = RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * seconds)
        self._times.append(self.until + seconds)
        self._poses.append(self.pose * step)

    def __call__(self, time: float) -> FloatArray:
        """Return the pose (7,) at a time [s], between two measured ones a screw motion."""
        after = int(np.clip(np.searchsorted(self._times, time), 1, max(len(self._times) - 1, 1)))
        if after == len(self._times):
            pose = self.pose
        else:
            begin, end = self._poses[after - 1], self._poses[after]
            share = (time - self._times[after - 1]) / (self._times[after] - self._times[after - 1])
            way = np.clip(share, 0.0, 1.0) * (begin.inv() * end).as_exp_coords()
            pose = begin * RigidTransform.from_exp_coords(way)
        return np.concatenate((pose.rotation.as_quat(), pose.translation))


def random_plan(seed: int, size_px: float) -> Plan | None:
    """Return a certified plan by a tag's corners; None: this seed gives none."""
    rng = np.random.default_rng([5, seed])
    distance = rng.uniform(0.5, 0.8)
    half = 0.5 * size_px * distance / CAMERA.fx
    corners = half * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
    tilt = rng.normal(size=2) * rng.choice([0.03, 0.3])
    turn = Rotation.from_rotvec([*tilt, rng.uniform(-0.5, 0.5)])
    points = turn.apply(corners) + np.append(0.1 * rng.uniform(-1, 1, 2), distance)
    goal = RigidTransform.from_components(
        rng.uniform(-0.12, 0.12, 3) + np.array([0.0, 0.0, 0.1]),
        Rotation.from_rotvec(0.2 * rng.normal(size=3)),
    )
    plan = plan_path(PlanningProblem(CAMERA, points, goal, least_distance=0.1, visibility_margin=10.0))
    return plan if plan.status == "certified" else None


def follow(plan: Plan, seed: int, noise_px: float) -> tuple[list[float], str, float]:
    """Follow a plan; return χ² of every state, the error that ended it or "", how far from the goal [m]."""
    rng, joints, squares = np.random.default_rng([6, seed]), Joints(), list[float]()
    options = TrackerOptions(delay=LATENCY + 0.5 * PERIOD)
    tracker = PathTracker(plan, CAMERA, options=options, time_law=RestToRestLaw(PATH_SECONDS))
    tracker.carried_by(joints)
    twist, stopped = np.zeros(6), ""
    for k in range(round(SECONDS / PERIOD)):
        pixels, _ = CAMERA.project(joints.pose.inv().apply(plan.problem.points))
        last = twist
        try:
            twist = tracker.step(k * PERIOD, pixels + noise_px * rng.standard_normal((4, 2)))
        except ServoStop as error:
            stopped = type(error).__name__
            break
        report = tracker.report
        assert report is not None
        stated = RigidTransform.from_components(
            report.filtered_pose[4:], Rotation.from_quat(report.filtered_pose[:4])
        )
        turn = (stated.rotation.inv() * joints.pose.rotation).as_rotvec()
        off = np.concatenate((joints.pose.translation - stated.translation, turn))
        squares.append(float(off @ np.linalg.solve(report.filtered_covariance, off)))
        joints.move(last, LATENCY)
        joints.move(twist, PERIOD - LATENCY)
        if tracker.done:
            break
    assert plan.problem.initial_T_goal is not None
    return squares, stopped, math.dist(joints.pose.translation, plan.problem.initial_T_goal.translation)


def lines(count: int) -> Iterator[str]:
    """Measure and say it."""
    for size_px in (16.0, 30.0, 60.0):
        for noise_px in (0.1, 0.3):
            first, later, stops, ends = list[float](), list[float](), list[str](), list[float]()
            for seed in range(count):
                plan = random_plan(seed, size_px)
                if plan is None:
                    continue
                squares, stopped, end = follow(plan, seed, noise_px)
                first += squares[:3]
                later += squares[3:]
                stops += [stopped] if stopped else []
                ends.append(end)
            yield (
                f"{size_px:.0f} px, noise {noise_px} px: {len(ends)} runs, {len(stops)} stopped"
                f" {sorted(set(stops))}, from the goal {1e3 * np.median(ends):.0f} mm (median),"
                f" {1e3 * max(ends):.0f} mm (most); first images {_held(first)}; later {_held(later)}"
            )


def _held(squares: list[float]) -> str:
    within, beyond = np.mean(np.array(squares) <= WITHIN), np.mean(np.array(squares) > BEYOND)
    return f"{within:.1%} within 95%, {beyond:.1%} beyond 5 sigma"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=40, help="scenes of each size")
    for line in lines(parser.parse_args().count):
        print(line, flush=True)


if __name__ == "__main__":
    main()
