"""The servo methods give the velocities that ViSP's own laws give, all along whole runs.

The scene is that of ViSP's tutorial-ibvs-4pts. What ViSP gave is kept in visp_velocities.txt, printed by
benchmarks/comparisons/visp/velocities.cpp; where the library is installed it is printed and compared again.
"""

import os
import shutil
import subprocess
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.servoing import AdaptiveGain, ServoMeasurement, servo_method

ROOT = Path(__file__).resolve().parents[2]
KEPT = Path(__file__).with_name("visp_velocities.txt")
PROGRAM = ROOT / "benchmarks/comparisons/visp/velocities.cpp"
LIBRARIES = ["-lvisp_vs", "-lvisp_visual_features", "-lvisp_robot", "-lvisp_core"]

TOLERANCE = 1e-12
PERIOD = 0.040  # [s]
CORNERS = np.array([[-0.1, -0.1, 0.0], [0.1, -0.1, 0.0], [0.1, 0.1, 0.0], [-0.1, 0.1, 0.0]])
GOAL_T_TARGET = RigidTransform.from_translation([0.0, 0.0, 0.75])
FIRST_T_TARGET = RigidTransform.from_components(
    [0.15, -0.1, 1.0], Rotation.from_rotvec([10.0, -10.0, 50.0], degrees=True)
)
METHODS = ("ibvs", "ibvs-desired", "ibvs-mean", "pbvs", "pbvs-target", "hybrid-2.5d")
GAINS = {"constant": 0.5, "adaptive": AdaptiveGain(4.0, 0.4, 30.0)}
RUNS = [f"{method}/{gain}" for method in METHODS for gain in GAINS]


def velocities(text):
    """Return of each run its velocities (iterations, 6)."""
    rows = [line.split() for line in text.splitlines()[1:]]
    runs = {
        name: np.array([r[2:] for r in rows if r[0] == name], dtype=float) for name in {r[0] for r in rows}
    }
    assert all([int(r[1]) for r in rows if r[0] == name] == list(range(len(runs[name]))) for name in runs)
    return runs


@pytest.fixture(scope="module")
def kept():
    return velocities(KEPT.read_text())


def seen_from(camera_T_target):
    """The four corners, without any camera's rounding."""
    now, goal = camera_T_target.apply(CORNERS), GOAL_T_TARGET.apply(CORNERS)
    distances, goal_distances = np.linalg.norm(now, axis=1), np.linalg.norm(goal, axis=1)
    return ServoMeasurement(
        0.0, now / distances[:, None], distances, goal / goal_distances[:, None], goal_distances,
        (GOAL_T_TARGET * camera_T_target.inv()).as_matrix(),
    )  # fmt: skip


@lru_cache
def closed_loop(name, iterations):
    """A camera that moves by its twist exactly, from the first view on: its twists (iterations, 6)."""
    method, gain = name.split("/")
    servo, camera_T_target, twists = servo_method(method, GAINS[gain]), FIRST_T_TARGET, []
    for _ in range(iterations):
        twist = servo.step(seen_from(camera_T_target))
        twists.append(twist)
        moved = RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * PERIOD)
        camera_T_target = moved.inv() * camera_T_target
    return np.array(twists)


def worst(ours, theirs):
    """Largest difference of a velocity, over the size of the run's largest one."""
    return np.abs(ours - theirs).max() / np.abs(theirs).max()


def test_what_is_kept_says_its_version_and_has_every_run_whole(kept):
    assert KEPT.read_text().splitlines()[0] == "# ViSP 3.5.0"
    assert sorted(kept) == sorted(RUNS)
    assert all(run.shape == (150, 6) for run in kept.values())


@pytest.mark.parametrize("name", RUNS)
def test_every_velocity_of_a_run_is_that_of_visp(kept, name):
    assert worst(closed_loop(name, 150), kept[name]) <= TOLERANCE


@pytest.mark.parametrize("name", RUNS)
def test_each_velocity_agrees_relative_to_itself_until_rounding_is_all_that_is_left(kept, name):
    """At a constant gain to the end; the adaptive one comes to 1e-5 of the first velocity and below."""
    ours, theirs = closed_loop(name, 150), kept[name]
    size = np.abs(theirs).max(axis=1)
    counts = size >= (0.05 * size[0] if name.endswith("adaptive") else 0.0)
    assert counts.sum() > 20
    assert (np.abs(ours - theirs).max(axis=1) / size)[counts].max() <= TOLERANCE


def test_the_library_still_prints_what_is_kept(kept, tmp_path):
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("no g++ here")
    build = [compiler, "-O2", "-w", "-I/usr/include/opencv4", *os.environ.get("LDFLAGS", "").split()]
    program = tmp_path / "velocities"
    built = subprocess.run([*build, "-o", program, PROGRAM, *LIBRARIES], capture_output=True, text=True)
    if built.returncode:
        pytest.skip(f"ViSP is not installed here (libvisp-dev): {built.stderr.splitlines()[0]}")
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    found = velocities(printed)
    assert sorted(found) == sorted(kept)
    for name in RUNS:
        assert worst(found[name], kept[name]) <= TOLERANCE
        assert worst(closed_loop(name, 150), found[name]) <= TOLERANCE
