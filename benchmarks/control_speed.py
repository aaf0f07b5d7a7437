"""Time of one control step: pixels in, camera twist out, nine points; and twist in, joints commanded.

Run: ``python -m benchmarks.control_speed``. Timed is the public `PathTracker.step` with compiled kernels,
every call on the image of a new instant along the path, as in a closed loop: checks, unprojection, pose
refinement, reference, control law and report. Then `Arm.joint_velocities` with `Supervisor.command`, all
limits and a workspace watched, on a robot that does what it is told and takes no time for it.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.planning import PlanningProblem, plan_path
from omniservo.robots import Arm, CameraImage, RobotState
from omniservo.safety import SafetyOptions, Supervisor
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


class ObedientRobot:
    """Joints that turn as they were told last, on a clock that `wait` alone moves on."""

    def __init__(self, joints: npt.ArrayLike) -> None:
        self._time, self._joints = 0.0, np.array(joints, dtype=np.float64)
        self._speeds = np.zeros(len(self._joints))

    def read(self) -> RobotState:
        """Return the joints as they are."""
        return RobotState(self._time, self._joints.copy(), self._speeds.copy())

    def image(self) -> CameraImage:
        """Return a picture taken now."""
        return CameraImage(self._time, np.zeros((1, 1), dtype=np.uint8))

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Turn with these speeds from now on."""
        self._speeds = np.array(joint_velocities, dtype=np.float64)

    def stop(self) -> None:
        """Stand still."""
        self._speeds[:] = 0.0

    def close(self) -> None:
        """Nothing is open."""

    def wait(self, duration: float) -> None:
        """Let time pass."""
        self._time += duration
        self._joints += duration * self._speeds


def command_microseconds(steps: int = 1000) -> float:
    """Return the median time from a camera twist to the joints' command, RX60 [µs]."""
    arm, robot = Arm.rx60(), ObedientRobot([0.2, 0.6, -1.6, 0.1, 1.2, 0.0])
    mount = RigidTransform.from_components([0.0, 0.0, 0.09], Rotation.from_rotvec([0.3, -0.8, 1.1]))
    options = SafetyOptions(workspace=np.array([[-1.0] * 3, [1.0] * 3]))
    supervisor = Supervisor(robot, arm, mount, camera=robot, wait=robot.wait, options=options)
    taken = []
    for i in range(steps):
        supervisor.image()
        supervisor.read()
        twist = 0.02 * np.array([np.cos(0.1 * i), np.sin(0.1 * i), 0.0, 0.1, np.cos(0.1 * i), 0.0])
        before = perf_counter()
        supervisor.carry(twist)
        taken.append(perf_counter() - before)
        supervisor.wait(1.0 / 30.0)
    return 1e6 * float(np.median(taken))


if __name__ == "__main__":
    print(f"control step, 9 points: {control_step_microseconds():.1f} us (median)")
    print(f"command, six joints: {command_microseconds():.1f} us (median)")
