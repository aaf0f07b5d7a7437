"""Scenes in which a wrong answer is tempting: how often is an estimate sure and wrong?

Run: ``python -m benchmarks.tempting_scenes [SCENES] [SEED]``. Two views, 20 to 60 points, 0.3 or 0.5 px of
noise that is not stated, in turn through a fisheye, a perspective lens and a mirror. An answer is sure and
wrong where the truth lies outside the 5 σ region of rotation and direction, that of F since σ comes from the
residuals, and one of them is off by more than 3°. Another SEED gives scenes that nothing was mended with.
"""

from __future__ import annotations

import math
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from benchmarks.tables import print_table
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import f as fisher
from scipy.stats import norm

from omniservo.cameras import UnifiedCamera, preset
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.geometry.arrays import FloatArray

CAMERAS = ("fe185", "perspective", "para-catadioptric")
BEYOND = float(2.0 * norm.sf(5.0))
"""probability of an error beyond 5 σ"""
SEED = 20261124
WRONG = math.radians(3.0)
RIGHT = 5
"""Of so many background points that are matched rightly a second motion is to be seen."""


@dataclass(frozen=True)
class Scene:
    """What two views are to show."""

    before: FloatArray
    """(n, 3) [m] points as the initial view sees them, initial camera frame"""
    after: FloatArray
    """(n, 3) [m] those that the goal view takes for them, initial camera frame too"""
    initial_T_goal: RigidTransform
    right: int
    """points that are matched rightly where most are not; n where few are wrong"""


def motion(rng: np.random.Generator, low: float = 0.1, high: float = 0.25) -> RigidTransform:
    """Return a displacement of ``low`` to ``high`` [m] and a turn of up to 20°."""
    direction, axis = rng.normal(size=(2, 3))
    turn = rng.uniform(0.05, 0.35) * axis / np.linalg.norm(axis)
    return RigidTransform.from_components(
        rng.uniform(low, high) * direction / np.linalg.norm(direction), Rotation.from_rotvec(turn)
    )


def ahead(distance: float) -> FloatArray:
    """Return a place on the axis of the initial camera [m]."""
    return np.array([0.0, 0.0, distance])


def cloud(rng: np.random.Generator, count: int) -> FloatArray:
    """Return points about half a metre ahead."""
    return rng.uniform([-0.25, -0.2, 0.4], [0.25, 0.2, 0.8], (count, 3))


def relief(rng: np.random.Generator) -> Scene:
    """A plane with relief of 1 to 50% of half its size."""
    n, half = int(rng.integers(20, 61)), 0.2
    flat = np.column_stack(
        [rng.uniform(-half, half, (n, 2)), half * rng.uniform(0.01, 0.5) * rng.uniform(-1, 1, n)]
    )
    points = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)).apply(flat) + ahead(0.5)
    return Scene(points, points, motion(rng), n)


def small_baseline(rng: np.random.Generator) -> Scene:
    """A baseline of 5 to 30 mm at half a metre."""
    points = cloud(rng, int(rng.integers(20, 61)))
    return Scene(points, points, motion(rng, 0.005, 0.03), len(points))


def moving_group(rng: np.random.Generator) -> Scene:
    """One rigid group, 20 to 45% of the points, moves by itself."""
    points = cloud(rng, int(rng.integers(20, 61)))
    group = round(rng.uniform(0.2, 0.45) * len(points))
    middle = points[rng.integers(len(points))]
    near = np.argsort(np.linalg.norm(points - middle, axis=1))[:group]
    after = points.copy()
    turned = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3))
    after[near] = turned.apply(points[near] - middle) + middle + rng.uniform(-0.08, 0.08, 3)
    return Scene(points, after, motion(rng), len(points))


def lattice(rng: np.random.Generator, low: float, high: float) -> Scene:
    """A lattice, ``low`` to ``high`` of it matched one period off, and some background points, right."""
    side, period = int(rng.integers(4, 7)), rng.uniform(0.03, 0.06)
    steps = period * (np.arange(side) - 0.5 * (side - 1))
    x, y = (a.ravel() for a in np.meshgrid(steps, steps))
    places = np.column_stack([x, y, 0.3 * period * rng.uniform(-1.0, 1.0, side**2)])
    pose = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3))
    shifted = rng.random(side**2) < rng.uniform(low, high)
    beside = places + np.array([period, 0.0, 0.0])
    matched = np.where(shifted[:, None], beside, places)
    grid, off = (pose.apply(p) + ahead(0.5) for p in (places, matched))
    background = cloud(rng, int(rng.integers(0 if low == 1.0 else 5, 15)))
    right = len(background) if low == 1.0 else side**2 + len(background)
    return Scene(np.concatenate((grid, background)), np.concatenate((off, background)), motion(rng), right)


def symmetric(rng: np.random.Generator) -> Scene:
    """A body of 2- or 4-fold symmetry matched to its turned self; 17 to 44% of the points are background."""
    fold, part = int(rng.choice([2, 4])), int(rng.integers(4, 9))
    seed = rng.uniform([0.02, -0.12, -0.1], [0.12, 0.12, 0.1], (part, 3))
    turns = [Rotation.from_rotvec([0.0, 0.0, 2.0 * math.pi * k / fold]) for k in range(fold)]
    body, turned = (np.concatenate([turns[(k + s) % fold].apply(seed) for k in range(fold)]) for s in (0, 1))
    pose, count = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)), len(body)
    share = rng.uniform(0.17, 0.44)
    background = cloud(rng, max(3, round(share / (1.0 - share) * count)))
    one, other = (pose.apply(p) + ahead(0.55) for p in (body, turned))
    before, after = np.concatenate((one, background)), np.concatenate((other, background))
    return Scene(before, after, motion(rng), len(background))


KINDS: dict[str, Callable[[np.random.Generator], Scene]] = {
    "plane with relief": relief,
    "baseline of 5 to 30 mm at 0.5 m": small_baseline,
    "20 to 45% of the points move": moving_group,
    "lattice, 30 to 70% one period off": lambda rng: lattice(rng, 0.3, 0.7),
    "lattice, all one period off": lambda rng: lattice(rng, 1.0, 1.0),
    "symmetric body matched to its turned self": symmetric,
}


def estimate(
    scene: Scene, camera: UnifiedCamera, noise: float, rng: np.random.Generator
) -> TwoViewEstimate | None:
    """Return what two noisy views of a scene say; None where they do not show all of it."""
    initial, seen = camera.project(scene.before)
    goal, seen_goal = camera.project(scene.initial_T_goal.inv().apply(scene.after))
    if not (seen.all() and seen_goal.all()):
        return None
    initial, goal = (p + noise * rng.normal(size=p.shape) for p in (initial, goal))
    return estimate_two_view(camera, initial, goal)


def is_sure_and_wrong(found: TwoViewEstimate, truth: RigidTransform) -> bool:
    """Tell whether the truth lies beyond 5 σ and 3°, ``found`` having a pose."""
    pose = found.initial_T_goal
    assert pose is not None
    direction = truth.translation / np.linalg.norm(truth.translation)
    turn = (truth.rotation.inv() * pose.rotation).as_rotvec()
    off = math.acos(float(np.clip(pose.translation @ direction, -1.0, 1.0)))
    if max(np.linalg.norm(turn), off) < WRONG:
        return False
    across = np.linalg.svd(direction[None])[2][1:]
    maps = np.zeros((5, 6))
    maps[:2, :3], maps[2:, 3:] = across, np.eye(3)
    error = maps @ np.concatenate((pose.translation - direction, turn))
    law = found.uncertainty
    assert law is not None
    most = 5.0 * float(fisher.isf(BEYOND, 5, min(law.freedom, 1e9)))  # infinite: χ²
    return bool(error @ np.linalg.solve(maps @ found.covariance @ maps.T, error) > most)


def answered(number: int, k: int, seed: int = SEED) -> tuple[Scene, TwoViewEstimate]:
    """Return the k-th scene of a kind of `KINDS`, and what is said of it."""
    rng, make = np.random.default_rng([seed, number, k]), list(KINDS.values())[number]
    while True:
        scene = make(rng)
        found = estimate(scene, preset(CAMERAS[k % 3]), (0.3, 0.5)[k % 2], rng)
        if found is not None:
            return scene, found


def main() -> None:
    """Print a row a kind of scene."""
    numbers = [int(a) for a in sys.argv[1:3]]
    count, seed = (*numbers, *(1000, SEED)[len(numbers) :])
    rows = []
    for number, name in enumerate(KINDS):
        said: Counter[str] = Counter()
        wrong = tempting = tempted = 0
        for k in range(count):
            scene, found = answered(number, k, seed)
            said[found.status] += 1
            wrong += found.status == "ok" and is_sure_and_wrong(found, scene.initial_T_goal)
            if RIGHT <= scene.right < len(scene.before):
                tempting += 1
                tempted += found.status == "ok"
        others = ", ".join(f"{status} {times}" for status, times in said.most_common() if status != "ok")
        few = f"{tempted} of {tempting}" if tempting else "–"
        rows.append(f"{name} | {count} | {said['ok']} | {wrong} | {few} | {others}")
    header = "scene | scenes | ok | sure and wrong | ok where most are wrong and 5 or more right"
    print_table(f"| {header} | refused as |", rows)


if __name__ == "__main__":
    main()
