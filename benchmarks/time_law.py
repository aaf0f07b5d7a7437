"""The time-optimal law beside the library's own bound, on random paths of three arms.

Run: ``python -m benchmarks.time_law``. The bound is the time that the library (toppra) finds with 6400 steps,
not stretched for what its grid does not see. Limits are looked at every millisecond of the law, with
differences of the law's own ẇ, as shares of what was allowed: half of the arm's speeds and accelerations, and
on every second path an image speed that binds as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from benchmarks.joint_path import FLANGE_T_CAMERA, STARTS, random_path

from omniservo.cameras import preset
from omniservo.planning import CameraPath
from omniservo.robots import Arm, JointPath, follow_path, load_arm
from omniservo.servoing import PathLimits, RestToRestLaw, TimeOptimalLaw, image_speed

SHARE = 0.5
"""of the arm's speeds and accelerations"""

PATHS = 100
BOUND_STEPS = 6400
POINTS = np.random.default_rng(1).uniform([-0.2, -0.2, 0.4], [0.2, 0.2, 0.6], (12, 3))


@dataclass(frozen=True)
class Row:
    """One path's law."""

    over_bound: float
    """duration over the bound, minus 1"""
    share: float
    """largest of all shares of limits"""
    rest_to_rest: float
    """its duration over that of the law"""
    milliseconds: float
    duration: float


def limits_of(arm: Arm, path: CameraPath, joints: JointPath, *, blurred: bool) -> PathLimits:
    """Return the limits; ``blurred``: with an image speed of 250 px/s, seen by the paper's fisheye."""
    camera = preset("fe185")
    bound = (lambda w: 250.0 / image_speed(camera, path, POINTS, w)) if blurred else None
    return PathLimits(joints, SHARE * arm.joint_speed, SHARE * arm.joint_acceleration, bound)


def measured(limits: PathLimits) -> Row:
    """Return one path's figures."""
    from omniservo.servoing.reachable_speeds import reachable_speeds

    taken = []
    for _ in range(2):
        before = perf_counter()
        law = TimeOptimalLaw(limits)
        taken.append(1e3 * (perf_counter() - before))
    grid = np.linspace(0.0, 1.0, BOUND_STEPS + 1)
    speeds = reachable_speeds(limits, grid)
    assert speeds is not None
    bound = float((2.0 * np.diff(grid) / (speeds[:-1] + speeds[1:])).sum())
    return Row(
        law.duration / bound - 1.0,
        largest_share(law, limits),
        RestToRestLaw.for_limits(limits).duration / law.duration,
        min(taken),
        law.duration,
    )


def largest_share(law: TimeOptimalLaw, limits: PathLimits) -> float:
    """Return the largest share of a limit, looked at every millisecond."""
    times, step = np.arange(0.0, law.duration, 1e-3), 1e-6
    ahead, here, behind = (np.array([law(t + s) for t in times]) for s in (step, 0.0, -step))
    w, speed, change = here[:, 0], here[:, 1:], (ahead[:, 1:] - behind[:, 1:]) / (2.0 * step)
    first, second = limits.joints(w, 1), limits.joints(w, 2)
    by_speed = (np.abs(first * speed) / limits.speeds).max()
    by_acceleration = (np.abs(second * speed**2 + first * change) / limits.accelerations).max()
    return float(max(by_speed, by_acceleration, (here[:, 1] / limits.top_path_speed(w)).max()))


def main() -> None:
    """Print one line an arm."""
    print(
        "| arm | paths | seconds, median | over the bound, median / worst | largest share of a limit "
        "| rest to rest takes, median | ms a law, median / worst |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, start in STARTS.items():
        arm, rng = load_arm(name), np.random.default_rng(7)
        base_T_initial = arm.base_T_flange(start) * FLANGE_T_CAMERA
        rows: list[Row] = []
        while len(rows) < PATHS:
            path = random_path(rng)
            joints = follow_path(arm, path, base_T_initial, FLANGE_T_CAMERA, start=start).best
            if joints.feasible:
                rows.append(measured(limits_of(arm, path, joints, blurred=len(rows) % 2 == 1)))
        over, shares, slower, taken, lasts = np.array(
            [(r.over_bound, r.share, r.rest_to_rest, r.milliseconds, r.duration) for r in rows]
        ).T
        print(
            f"| {name} | {len(rows)} | {np.median(lasts):.2f} | {100 * np.median(over):.2f}% / "
            f"{100 * over.max():.2f}% | {100 * shares.max():.3f}% | {np.median(slower):.2f}× "
            f"| {np.median(taken):.0f} / {taken.max():.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
