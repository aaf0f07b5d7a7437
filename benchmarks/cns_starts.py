"""The 150 starts of the CNS benchmark, and its rule of success, on projected points of our own scenes.

Run: ``python -m benchmarks.cns_starts [FOLDER] [--count N]``. FOLDER holds the JSON files of
https://github.com/hhcaz/CNS, ``cns/benchmark/scenes`` (MIT; read, not shipped): goal and start of each of 150
episodes are taken from there. Without it as many are drawn by the same rule, which that repository's
``cns/sim`` states: a camera 0.5 to 0.9 m from the middle of the scene, looking at it from 70 to 90° (goal) or
30 to 90° (start) above the ground, turned about its axes by up to 15, 5, 5° (goal) or 60, 10, 10° (start).

As there, the camera has 640 × 480 px and f = 540 px; the third with the smallest rotation is S, then M and L;
success is a last pose within a tenth of the goal camera's distance to the middle, and within 10°. Theirs are
rendered objects; ours 30 points in a cylinder of 0.2 m radius and 0.1 m height, of those seen in both images,
with 0.3 px of noise. They are given the goal's distance to the scene, ours the distance between the two
camera centres. 50 images a second, 12 s at most (their 600 steps), gain 2/s.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
from benchmarks.scene_runs import METHODS, Run, run_method_on, scene_of, study_of
from benchmarks.tables import print_table
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.geometry.arrays import FloatArray
from omniservo.studies import Rate

CAMERA = UnifiedCamera(540.0, 540.0, 320.0, 240.0, 0.0, 640, 480)
POINTS, RADIUS, HEIGHT, NOISE = 30, 0.2, 0.1, 0.3
LEAST_POINTS = 8
EDGE = 10.0
"""[px] that points keep to the image's edges at both ends"""
SECTIONS = {
    "images": {"rate": 50.0},
    "servo": {"gain": 2.0, "linear_speed": 0.5, "angular_speed": 1.5},
    "limits": {"seconds": 12.0},
}
Episode = tuple[RigidTransform, RigidTransform]
"""world_T_goal and world_T_initial"""


def read_episodes(folder: Path) -> list[Episode]:
    """Return the episodes of all JSON files."""
    entries = [entry for file in sorted(folder.glob("*.json")) for entry in json.loads(file.read_text())]
    return [
        (RigidTransform.from_matrix(entry["target_wcT"]), RigidTransform.from_matrix(entry["initial_wcT"]))
        for entry in entries
    ]


def drawn_episodes(count: int) -> list[Episode]:
    """Return as many drawn by the same rule."""
    rng = np.random.default_rng(150)
    return [(_pose(rng, 70.0, (15.0, 5.0, 5.0)), _pose(rng, 30.0, (60.0, 10.0, 10.0))) for _ in range(count)]


def _pose(rng: np.random.Generator, lowest: float, turns: tuple[float, float, float]) -> RigidTransform:
    distance, round_up = rng.uniform(0.5, 0.9), rng.uniform(-np.pi, np.pi)
    height = rng.uniform(np.sin(np.deg2rad(lowest)), 1.0)
    level = np.sqrt(1.0 - height**2)
    place = np.array([level * np.cos(round_up), level * np.sin(round_up), height])
    down = np.array([height * np.cos(round_up), height * np.sin(round_up), -level])
    axes = np.column_stack((np.cross(down, -place), down, -place))
    z, y, x = (rng.uniform(-most, most) for most in turns)
    turn = Rotation.from_matrix(axes) * Rotation.from_euler("ZYX", [z, y, x], degrees=True)
    return RigidTransform.from_components(distance * place, turn)


def points_of(episode: Episode, seed: int) -> FloatArray:
    """Return points (n, 3) in the world that both images show."""
    rng = np.random.default_rng([seed, 0])
    round_up, out = rng.uniform(-np.pi, np.pi, 400), RADIUS * np.sqrt(rng.random(400))
    up = rng.uniform(0.0, HEIGHT, 400)
    points = np.column_stack((out * np.cos(round_up), out * np.sin(round_up), up))
    shown = np.ones(len(points), dtype=np.bool_)
    for pose in episode:
        pixels, valid = CAMERA.project(pose.inv().apply(points))
        inside = (pixels > EDGE) & (pixels < [CAMERA.width - EDGE, CAMERA.height - EDGE])
        shown &= valid & inside.all(axis=1)
    return points[shown][:POINTS]


def run(episode: Episode, method: str, seed: int) -> Run | None:
    """Run a method; None: fewer than 8 points are seen in both images."""
    world_T_goal, world_T_initial = episode
    points = points_of(episode, seed)
    if len(points) < LEAST_POINTS:
        return None
    initial = world_T_initial.inv()
    scene = scene_of(CAMERA, initial.apply(points), initial * world_T_goal, NOISE)
    return run_method_on(study_of("cns-starts", CAMERA, method, **SECTIONS), scene, seed)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="?", type=Path)
    parser.add_argument("--count", type=int, default=150, help="of starts that are drawn")
    parser.add_argument("--method", action="append", help="default: all")
    given = parser.parse_args()
    episodes = read_episodes(given.folder) if given.folder else drawn_episodes(given.count)
    turned = np.array([(goal.inv() * start).rotation.magnitude() for goal, start in episodes])
    thirds = np.array_split(np.argsort(turned), 3)
    unseen = [k for k, episode in enumerate(episodes) if len(points_of(episode, k)) < LEAST_POINTS]
    print(
        f"{len(episodes)} starts, {'of the CNS benchmark' if given.folder else 'drawn by its rule'};", end=" "
    )
    print(f"{len(unseen)} without {LEAST_POINTS} points seen in both images, which count as failures\n")
    ends = [
        f"{n} {np.rad2deg(turned[t].min()):.0f}–{np.rad2deg(turned[t].max()):.0f}°"
        for n, t in zip("SML", thirds, strict=True)
    ]
    print_table(
        f"| method | {' | '.join(ends)} | error, median of the successful | way / straight | else |",
        (_row(episodes, thirds, method) for method in given.method or METHODS),
    )


def _row(episodes: list[Episode], thirds: list[FloatArray], method: str) -> str:
    runs = [run(episode, method, k) for k, episode in enumerate(episodes)]
    good = [r is not None and _reached(r, e) for r, e in zip(runs, episodes, strict=True)]
    cells = []
    for third in thirds:
        rate = Rate(sum(good[k] for k in third), len(third))
        low, high = (100 * end for end in rate.interval)
        cells.append(f"{100 * rate.share:.0f}% ({low:.0f}–{high:.0f})")
    done = [(r, e) for r, e, ok in zip(runs, episodes, good, strict=True) if ok and r is not None]
    off = np.median([[1e3 * r.translation, np.rad2deg(r.rotation)] for r, _ in done], axis=0)
    way = np.median([r.length / np.linalg.norm((e[0].inv() * e[1]).translation) for r, e in done])
    failed = [
        f"{k} {r.status if r else 'unseen'}"
        for k, (r, ok) in enumerate(zip(runs, good, strict=True))
        if not ok
    ]
    more = f"{len(failed)}: {', '.join(failed[:4])}" if failed else "–"
    return f"`{method}` | {' | '.join(cells)} | {off[0]:.1f} mm, {off[1]:.2f}° | {way:.2f} | {more}"


def _reached(found: Run, episode: Episode) -> bool:
    distance = float(np.linalg.norm(episode[0].translation))
    return found.translation < 0.1 * distance and found.rotation < np.deg2rad(10.0)


if __name__ == "__main__":
    main()
