"""Servo laws of machinevision-toolbox-python beside ours: the same velocities, and from how far they come.

Run: ``python -m benchmarks.comparisons.machine_vision.compare``, with the toolbox in an environment of its
own, because its OpenCV replaces ours: ``python -m venv runs/mvtb; runs/mvtb/bin/pip install
machinevision-toolbox-python``. Its classes IBVS and PBVS are run as they are, at a gain of 0.1 a step, on 20
points in a cube of 0.3 m before a perspective camera (640 × 480, f = 540 px), without noise and with true
depths, from starts turned by so much about any axis, at 0.8 to 1.5 times the goal's distance.

First, at every pose of its own runs, its twist beside that of our law for the same view: the largest
difference, over the run's largest twist. It moves by the twist's first-order matrix made orthogonal, and
PBVS by an interpolated pose that OpenCV finds from the pixels. Then whole runs, ours by the exponential map:
within 1 mm and 0.1° of the goal after 400 steps, and the median of the way over the straight one. Times are
CPU times of a step, ours with nothing but the law, its with its projection and pose.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing import ServoMeasurement, servo_method

PYTHON = Path("runs/mvtb/bin/python")
PROGRAM = Path(__file__).with_name("loops.py")
FOCAL, SIZE, CENTRE = 540.0, (640, 480), (320.0, 240.0)
GAIN, STEPS = 0.1, 400
TURNS, STARTS = ((5, 60), (60, 120), (120, 180)), 20
PAIRS = {"IBVS": "ibvs", "PBVS": "pbvs"}
OURS = ("ibvs", "ibvs-mean", "pbvs", "hybrid-2.5d")
NEAR_M, NEAR_RAD = 1e-3, np.radians(0.1)


@dataclass(frozen=True)
class Way:
    """Where a run went."""

    centres: FloatArray
    """(k, 3) [m]"""
    end: RigidTransform
    """goal_T_camera"""

    @property
    def reached(self) -> bool:
        """Whether it ends at the goal."""
        off = np.linalg.norm(self.end.translation), self.end.rotation.magnitude()
        return bool(off[0] < NEAR_M and off[1] < NEAR_RAD)

    @property
    def detour(self) -> float:
        """The way over the straight one."""
        pieces = np.linalg.norm(np.diff(self.centres, axis=0), axis=1).sum()
        return float(pieces / np.linalg.norm(self.centres[0] - self.centres[-1]))


def scene(random: np.random.Generator) -> tuple[FloatArray, RigidTransform]:
    """Return points (n, 3) and the goal's pose, in the target's frame."""
    points = random.uniform(-0.15, 0.15, (20, 3))
    return points, RigidTransform.from_translation([0.0, 0.0, -0.7])


def drawn_start(points: FloatArray, turn: tuple[int, int], random: np.random.Generator) -> RigidTransform:
    """Return a pose that sees all points in its image."""
    while True:
        axis = random.standard_normal(3)
        rotation = Rotation.from_rotvec(np.radians(random.uniform(*turn)) * axis / np.linalg.norm(axis))
        middle = np.array([*random.uniform(-0.1, 0.1, 2), 0.7 * random.uniform(0.8, 1.5)])
        start = RigidTransform.from_components(-rotation.apply(middle), rotation)
        seen = start.inv().apply(points)
        pixels = FOCAL * seen[:, :2] / seen[:, 2:] + CENTRE
        if (seen[:, 2] > 0.1).all() and ((pixels > 0) & (pixels < SIZE)).all():
            return start


def measured(points: FloatArray, goal: RigidTransform, pose: RigidTransform) -> ServoMeasurement:
    """Return what is seen from a pose, without noise."""
    now, then = pose.inv().apply(points), goal.inv().apply(points)
    far, goal_far = np.linalg.norm(now, axis=1), np.linalg.norm(then, axis=1)
    relative = (goal.inv() * pose).as_matrix()
    return ServoMeasurement(0.0, now / far[:, None], far, then / goal_far[:, None], goal_far, relative)


def our_way(points: FloatArray, goal: RigidTransform, start: RigidTransform, name: str) -> tuple[Way, float]:
    """Return where a law of ours leads, and its CPU time of a step [s]."""
    law, pose, centres, seconds = servo_method(name, GAIN), start, [start.translation], 0.0
    for _ in range(STEPS):
        seen = measured(points, goal, pose)
        before = process_time()
        try:
            twist = law.step(seen)
        except ServoStop:
            break
        seconds += process_time() - before
        pose = pose * RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])))
        centres.append(pose.translation)
    return Way(np.array(centres), goal.inv() * pose), seconds / max(len(centres) - 1, 1)


def their_way(goal: RigidTransform, run: dict[str, list[list[list[float]]]]) -> Way:
    """Return where a run of the toolbox went."""
    poses = np.array(run["poses"])
    return Way(poses[:, :3, 3], goal.inv() * RigidTransform.from_matrix(poses[-1]))


def apart(points: FloatArray, goal: RigidTransform, run: dict[str, list[list[list[float]]]]) -> float:
    """Return the largest difference of twists at the toolbox's poses, over its largest twist."""
    theirs, law = np.array(run["twists"]), servo_method(PAIRS[str(run["law"])], GAIN)
    poses = [RigidTransform.from_matrix(np.array(pose)) for pose in run["poses"][: len(theirs)]]
    ours = np.array([law.step(measured(points, goal, pose)) for pose in poses])
    return float(np.abs(ours - theirs).max() / np.abs(theirs).max())


def lines() -> Iterator[str]:
    """Yield the tables."""
    if not PYTHON.exists():
        yield f"Not run: {PYTHON} is missing.\n"
        return
    random = np.random.default_rng(0)
    points, goal = scene(random)
    ranges = [turn for turn in TURNS for _ in range(STARTS)]
    starts = [drawn_start(points, turn, random) for turn in ranges]
    given = {
        "focal": FOCAL, "size": SIZE, "centre": CENTRE, "points": points.tolist(), "gain": GAIN,
        "goal": goal.as_matrix().tolist(), "starts": [s.as_matrix().tolist() for s in starts],
        "steps": STEPS,
    }  # fmt: skip
    asked = subprocess.run([PYTHON, PROGRAM], input=json.dumps(given), capture_output=True, text=True)
    if asked.returncode:
        yield f"Not run: {asked.stderr.strip().splitlines()[-1]}\n"
        return
    found = json.loads(asked.stdout)
    runs = {law: [run for run in found["runs"] if run["law"] == law] for law in PAIRS}
    yield f"machinevision-toolbox-python {found['version']}.\n"
    yield from _velocities(points, goal, runs)
    yield from _ways(points, goal, starts, runs)


def _velocities(
    points: FloatArray, goal: RigidTransform, runs: dict[str, list[dict[str, list[list[list[float]]]]]]
) -> Iterator[str]:
    yield "| law | runs that reach the goal | poses compared | largest difference of a twist |"
    yield "|---|---|---|---|"
    for law, own in runs.items():
        good = [run for run in own if their_way(goal, run).reached]
        worst = max(apart(points, goal, run) for run in good)
        count = sum(len(run["twists"]) for run in good)
        yield f"| {law}, `{PAIRS[law]}` | {len(good)} of {len(own)} | {count} | {worst:.0e} |"
    yield ""


def _ways(
    points: FloatArray,
    goal: RigidTransform,
    starts: list[RigidTransform],
    runs: dict[str, list[dict[str, list[list[list[float]]]]]],
) -> Iterator[str]:
    turns = " | ".join(f"{low}–{high}°" for low, high in TURNS)
    yield f"| law | {turns} | ms a step |"
    yield "|---|---|---|---|---|"
    for law, own in runs.items():
        seconds = float(np.median([run["seconds"] for run in own]))
        yield _line(f"toolbox, {law}", [their_way(goal, run) for run in own], seconds)
    for name in OURS:
        both = [our_way(points, goal, start, name) for start in starts]
        yield _line(f"omniservo, `{name}`", [way for way, _ in both], float(np.median([s for _, s in both])))


def _line(name: str, ways: list[Way], seconds: float) -> str:
    cells = []
    for k in range(len(TURNS)):
        some = ways[k * STARTS : (k + 1) * STARTS]
        good = [way.detour for way in some if way.reached]
        cells.append(f"{len(good)} of {len(some)}" + (f", {np.median(good):.2f}" if good else ""))
    return f"| {name} | {' | '.join(cells)} | {1e3 * seconds:.2f} |"


if __name__ == "__main__":
    for line in lines():
        print(line)
