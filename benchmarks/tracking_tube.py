"""How far simulated arms stray from their paths: the tubes that are shipped.

Run: ``python -m benchmarks.tracking_tube [--arm NAME] [--runs 400] [--out FOLDER]``. Random tasks of 20
points (`tests.whole_arm.arm_scenes`), planned with the arm and followed in the closed loop at 30 frames a
second, 20 ms late, with 0.5 px of noise in every frame, drives with acceleration limits, and the
rest-to-rest law with half of the arm's speeds and accelerations. Structure, camera and mount are true: what
errors of theirs do is not the tracking's. Points keep as far inside the image as the visibility filter asks,
which would hold the arm back otherwise, and as a task does that says nothing else; none is nearer to the
camera than 5 cm. With ``--out`` the tubes
are written there as ``NAME.tube.json``.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmarks.arm_runs import LEAST_DISTANCE, NOISE_PX, SPARSE, TARGET, VISIBLE_PX, Truth, execute
from benchmarks.tables import print_table
from tests.whole_arm.arm_scenes import FLANGE_T_CAMERA, random_task

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import CAMERA_HOUSING, Arm, ArmBodies, TrackingTube, load_arm, shipped_arms, strayed
from omniservo.whole_arm import plan_with_arm

SHARE = 0.01
"""of runs that may leave the tube that is printed"""

SEED = 516

REGULAR = 0.1
"""The planned postures keep at least this smallest singular value."""


def runs_of(arm: Arm, count: int) -> Iterator[FloatArray]:
    """Yield what so many runs strayed by (n + 2,)."""
    seed = done = 0
    while done < count:
        seed += 1
        random = np.random.default_rng([SEED, seed])
        problem, setting = random_task(arm, random, **TARGET)
        problem = replace(problem, visibility_margin=VISIBLE_PX, least_distance=LEAST_DISTANCE)
        found = plan_with_arm(problem, replace(setting, singular_value=REGULAR))
        if not found.certified or found.branch is None or setting.start is None:
            continue
        balls = [(np.array(o.center), o.radius) for o in problem.obstacles]
        truth = Truth(arm, setting.start, setting.flange_T_camera, problem.camera, problem.points, balls)
        run = execute(truth, found.plan, found.branch, random)
        if run.stop:
            continue
        done += 1
        yield strayed(carried(arm), setting.flange_T_camera, run.path, run.joints[::SPARSE], run.image_px)


def carried(arm: Arm) -> ArmBodies:
    """Return the arm with the camera's housing, and nothing around."""
    return ArmBodies(arm, mounted=[solid.moved(FLANGE_T_CAMERA) for solid in CAMERA_HOUSING])


def tube_of(arm: Arm, count: int) -> TrackingTube:
    """Return the tube of so many runs."""
    seen = f"{TARGET['points']} points, {VISIBLE_PX:g} px inside, {NOISE_PX} px of noise, 30 Hz, 20 ms late"
    source = f"{count} simulated runs on random tasks, {seen}; python -m benchmarks.tracking_tube"
    return TrackingTube.of(arm.name, carried(arm).tube_parts, list(runs_of(arm, count)), REGULAR, source)


def main() -> None:
    """Print the tubes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--arm", choices=shipped_arms(), action="append")
    parser.add_argument("--runs", type=int, default=400, help="an arm")
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()

    def rows() -> Iterator[str]:
        for name in asked.arm or shipped_arms():
            measured = tube_of(load_arm(name), asked.runs)
            if asked.out is not None:
                measured.save(asked.out / f"{name}.tube.json", force=True)
            tube, half = measured.at(SHARE), np.median(measured.ratios) * measured.shape
            joints = ", ".join(f"{angle:.0f}" for angle in 1e3 * tube.joints)
            links = ", ".join(
                f"{name} {1e3 * most:.1f}" for name, most in tube.links.items() if "&" not in name
            )
            camera = f"{1e3 * tube.position:.1f} | {tube.image:.1f}"
            yield f"{name} | {measured.runs} | {joints} | {links} | {camera} | {1e3 * half[-2]:.1f}"

    print_table(
        "| arm | runs | joints [mrad] | links [mm] | camera [mm] | image [px] | camera, half of the "
        "runs [mm] |",
        rows(),
    )


if __name__ == "__main__":
    main()
