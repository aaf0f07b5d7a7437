"""Does what one or two more images say of the goal hold, and how much better is it known?

Run: ``python -m benchmarks.look_coverage [--scenes 60]``. Scenes as in `tests.estimation.test_arm_views`: 24
points about half a metre before a fisheye, a goal some 0.15 m and 20° away, 5% of scale, a mount off by 2 mm
and 0.2°, further images from 8 cm aside (`estimate_arm_views`).
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2
from tests.estimation.test_arm_views import ASIDE, normal_square, views_of

from omniservo.estimation.estimate_arm_views import estimate_arm_views

ABOVE = RigidTransform.from_components([0.0, 0.08, 0.0], Rotation.from_rotvec([0.15, 0.0, -0.1]))

CASES = {
    "lens off by 2%, stated": {},
    "lens exact": {"lens": 0.0},
    "lens exact, 20% of a look's matches wrong": {"lens": 0.0, "wrong": 0.2},
    "model error of 0.3 px, 0.1 px of noise": {"lens": 0.0, "field": 0.3, "noise": 0.1},
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--scenes", type=int, default=60)
    scenes = parser.parse_args().scenes
    print("| case | looks | scenes | median error [mm] | [deg] | σ [mm] | 50% holds | 95% holds |")
    print("|---|---|---|---|---|---|---|---|")
    for name, changes in CASES.items():
        for looks in ((ASIDE,), (ASIDE, ABOVE)):
            found = []
            for seed in range(scenes):
                goal, _, views, start = views_of(seed, looks=looks, **changes)
                if start.status != "ok":
                    continue
                estimate, _ = estimate_arm_views(views, start)
                if estimate.status != "ok":
                    continue
                off = estimate.initial_T_goal.translation - goal.translation
                turn = (goal.rotation.inv() * estimate.initial_T_goal.rotation).magnitude()
                sigma = np.sqrt(np.trace(estimate.covariance[:3, :3]))
                square = normal_square(goal, estimate)
                found.append((1e3 * np.linalg.norm(off), np.degrees(turn), 1e3 * sigma, square))
            rows = np.array(found)
            held = [100.0 * np.mean(rows[:, 3] < chi2.ppf(share, 6)) for share in (0.5, 0.95)]
            median = np.median(rows, axis=0)
            print(
                f"| {name} | {len(looks)} | {len(rows)} | {median[0]:.1f} | {median[1]:.2f} |"
                f" {median[2]:.1f} | {held[0]:.0f}% | {held[1]:.0f}% |",
                flush=True,
            )


if __name__ == "__main__":
    main()
