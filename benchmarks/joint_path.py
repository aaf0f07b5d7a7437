"""Time of a joint path: one camera path followed on every branch of three arms.

Run: ``python -m benchmarks.joint_path``. Timed is the public `follow_path`, the search for the starts with
it, divided by the branches; smallest of the passes, because other load on the machine only adds. The paths
are random quadratics that the arm can begin; beside them, a share of the branches ends early, in a
singularity.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.planning import CameraPath
from omniservo.robots import FollowedPath, follow_path, load_arm

STARTS = {
    "rx60": [0.2, 0.6, -1.6, 0.1, 1.2, 0.0],
    "ur5e": [0.0, -1.5, 1.5, -1.5, -1.5, 0.1],
    "panda": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
}
"""Joints where the paths begin, in the middle of the room [rad]."""

FLANGE_T_CAMERA = RigidTransform.from_components([0.03, -0.02, 0.09], Rotation.from_rotvec([0.3, -0.8, 1.1]))


def random_path(rng: np.random.Generator) -> CameraPath:
    """Return a quadratic that moves the camera by about 0.2 m and 20 deg."""
    rotation = np.zeros((4, 3))
    rotation[:3, :2] = 0.07 * rng.standard_normal((3, 2))
    rotation[3, 2] = 1.0
    translation = np.column_stack([0.08 * rng.standard_normal((3, 2)), np.zeros(3)])
    return CameraPath(rotation, translation)


def timed(name: str, paths: int = 10, passes: int = 5) -> tuple[list[FollowedPath], np.ndarray, float]:
    """Return an arm's results, [ms] a branch of each path, and [ms] for finding one path's starts."""
    arm, rng = load_arm(name), np.random.default_rng(0)
    base_T_initial = arm.base_T_flange(STARTS[name]) * FLANGE_T_CAMERA
    results, taken = [], []
    for path in [random_path(rng) for _ in range(paths)]:
        times = []
        for _ in range(passes):
            before = perf_counter()
            result = follow_path(arm, path, base_T_initial, FLANGE_T_CAMERA)
            times.append(1e3 * (perf_counter() - before) / len(result.branches))
        results.append(result)
        taken.append(min(times))
    starts = []
    for _ in range(passes):
        before = perf_counter()
        arm.branches(arm.base_T_flange(STARTS[name]))
        starts.append(1e3 * (perf_counter() - before))
    return results, np.array(taken), min(starts)


def main() -> None:
    """Print one line an arm."""
    print(
        "| arm | branches a path | that lead to the end "
        "| ms a branch, median / worst | of it: starts, ms a path |"
    )
    print("|---|---|---|---|---|")
    for name in STARTS:
        results, taken, starts = timed(name)
        branches = [b for result in results for b in result.branches]
        share = sum(b.w[-1] == 1.0 for b in branches) / len(branches)
        count, times = len(branches) / len(results), f"{np.median(taken):.1f} / {taken.max():.1f}"
        print(f"| {name} | {count:.1f} | {100 * share:.0f}% | {times} | {starts:.1f} |", flush=True)


if __name__ == "__main__":
    main()
