"""Time of one control step: pixels in, camera twist out, nine points.

Run: ``python -m benchmarks.control_speed``. Timed is the public `PathTracker.step` with compiled kernels,
every call on the image of a new instant along the path, as in a closed loop: checks, unprojection, pose
refinement, reference, control law and report.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from omniservo.cameras import preset
from omniservo.planning import PlanningProblem, plan_path
from omniservo.tracking import PathTracker, TrackerOptions

TARGET = np.array(
    [
        [0.08 * i, 0.06 * k - 0.08, 0.40 - 0.07 * abs(i) + 0.004 * (-1) ** (i + k)]
        for k in (-1, 0, 1)
        for i in (-1, 0, 1)
    ]
)
"""Nine dots on two boards that meet at a ridge, as in the paper's example 1 [m]."""


def control_step_microseconds(steps: int = 1000, noise: float = 0.05) -> float:
    """Return the median time of `PathTracker.step` along the paper's example 1 [µs].

    Args:
        steps: images, spread over the four seconds of the path.
        noise: standard deviation of the pixels [px].
    """
    camera = preset("fe185")
    plan = plan_path(
        PlanningProblem.from_dict(
            {
                "format": "omniservo.problem/1",
                "camera": camera.to_dict(),
                "points": TARGET.tolist(),
                "goal": {"translation": [0.0, -0.1, 0.2], "quaternion": [0.0, 0.0, 0.0, 1.0]},
            }
        )
    )
    assert plan.path is not None
    tracker = PathTracker(plan, camera, options=TrackerOptions(delay=0.037))
    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 4.0, steps)
    images = []
    for time in times:
        seen = plan.path(tracker.time_law(time)[0]).inv().apply(TARGET)
        images.append(camera.project(seen)[0] + noise * rng.standard_normal((9, 2)))
    tracker.step(0.0, images[0])
    taken = []
    for time, pixels in zip(times, images, strict=True):
        before = perf_counter()
        tracker.step(time, pixels)
        taken.append(perf_counter() - before)
    return 1e6 * float(np.median(taken))


if __name__ == "__main__":
    print(f"control step, 9 points: {control_step_microseconds():.1f} us (median)")
