"""From how far every servo method without a plan reaches the goal: a free camera, projected pixels.

Run: ``python -m benchmarks.servo_methods [STARTS]``. A target of nine points on two boards, 0.6 m before the
goal; the camera starts up to 0.2 m aside, tilted by up to 20° and turned about its axis by the angle of the
column, so that it sees all points. Structure and goal pose are estimated from the two images (0.2 px of
noise, the distance between the two cameras known), and nothing else is given to the methods. The loop: 30
frames a second for 10 s, gain 2/s, the camera moves exactly as told; a point outside the image is lost, no
filter keeps it inside. The goal is reached within 10 mm and 1°. Way: path of the camera's centre over the
straight one, median of those that reach it. Time: of a step, measurement and law, the quickest of all.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import ServoStop
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing import SERVO_METHODS, servo_method
from omniservo.tracking import GoalServo, GoalServoOptions

CAMERAS = {
    "perspective": UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480),
    "fisheye, 185°": preset("fe185"),
}
TURNS = {"to 60°": (0.0, 60.0), "60–120°": (60.0, 120.0), "150–179°": (150.0, 179.0)}
"""about the optical axis [deg]"""
TARGET = np.array(
    [[0.1 * i, 0.08 * k, 0.6 - 0.1 * abs(i) + 0.02 * i * k] for i in (-1, 0, 1) for k in (-1, 0, 1)]
)
"""in the goal's camera frame [m]"""
ASIDE, TILT, NOISE_PX = 0.2, 20.0, 0.2
PERIOD, SECONDS, GAIN = 1.0 / 30.0, 10.0, 2.0
NEAR, TURNED = 0.010, np.deg2rad(1.0)


@dataclass(frozen=True, eq=False)
class Start:
    """Where a run begins, and what its two images say."""

    goal_T_initial: RigidTransform
    goal_pixels: FloatArray
    estimate: TwoViewEstimate
    seed: int


@dataclass(frozen=True)
class Ended:
    """How a run ended."""

    how: str
    """"goal", "elsewhere", or the name of a stop"""
    way: float
    seconds: float
    """of the quickest step"""


def starts(camera: UnifiedCamera, turns: tuple[float, float], count: int) -> Iterator[Start]:
    """Yield so many; the same for every method."""
    seed = 0
    while count:
        seed += 1
        rng = np.random.default_rng(seed)
        tilt = Rotation.from_rotvec([*rng.uniform(-TILT, TILT, 2), 0.0], degrees=True)
        turn = Rotation.from_rotvec([0.0, 0.0, rng.choice([-1.0, 1.0]) * rng.uniform(*turns)], degrees=True)
        pose = RigidTransform.from_components(rng.uniform(-ASIDE, ASIDE, 3), tilt * turn)
        views = [camera.project(p.inv().apply(TARGET)) for p in (pose, RigidTransform.identity())]
        if not all(valid.all() and camera.in_image(pixels).all() for pixels, valid in views):
            continue
        initial, goal = (pixels + NOISE_PX * rng.standard_normal(pixels.shape) for pixels, _ in views)
        apart = float(np.linalg.norm(pose.translation))
        estimate = estimate_two_view(camera, initial, goal, scale=apart, noise=NOISE_PX)
        if estimate.status == "ok":
            count -= 1
            yield Start(pose, goal, estimate, seed)


def run(camera: UnifiedCamera, name: str, start: Start) -> Ended:
    """Servo once."""
    pose, rng, way, fastest = start.goal_T_initial, np.random.default_rng(start.seed), 0.0, np.inf
    servo = GoalServo(
        camera, start.estimate.points, start.goal_pixels, method=servo_method(name, GAIN),
        initial_T_goal=start.estimate.initial_T_goal, options=GoalServoOptions(tolerance_px=NOISE_PX),
    )  # fmt: skip
    for k in range(round(SECONDS / PERIOD)):
        pixels, valid = camera.project(pose.inv().apply(TARGET))
        seen = valid & camera.in_image(np.where(valid[:, None], pixels, -1e3))
        noisy = pixels + NOISE_PX * rng.standard_normal(pixels.shape)
        begun = perf_counter()
        try:
            twist = servo.step(k * PERIOD, noisy, seen)
        except ServoStop as stop:
            return Ended(stop.reason, way, fastest)
        fastest = min(fastest, perf_counter() - begun)
        moved = RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * PERIOD)
        pose, way = pose * moved, way + float(np.linalg.norm(moved.translation))
    there = np.linalg.norm(pose.translation) <= NEAR and pose.rotation.magnitude() <= TURNED
    straight = float(np.linalg.norm(start.goal_T_initial.translation))
    return Ended("goal" if there else "elsewhere", way / straight, fastest)


def main(count: int = 20) -> None:
    """Print one table for each camera."""
    for camera_name, camera in CAMERAS.items():
        print(f"\n{camera_name}, {count} starts in each column\n")
        print("| method |", " | ".join(f"{turn}: goal, way, else" for turn in TURNS), "| step [µs] |")
        print("|---|", "---|" * (len(TURNS) + 1), sep="")
        given = {turn: list(starts(camera, limits, count)) for turn, limits in TURNS.items()}
        for name in SERVO_METHODS:
            cells, fastest = [], np.inf
            for each in given.values():
                ends = [run(camera, name, start) for start in each]
                fastest = min(fastest, *(end.seconds for end in ends))
                ways = [end.way for end in ends if end.how == "goal"]
                others = Counter(end.how for end in ends if end.how != "goal")
                said = ", ".join(f"{how} {k}" for how, k in others.most_common())
                cells.append(f"{len(ways)}, {np.median(ways) if ways else np.nan:.2f}, {said or '–'}")
            print(f"| `{name}` |", " | ".join(cells), f"| {1e6 * fastest:.0f} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
