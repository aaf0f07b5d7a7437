"""Gaps in the images in mid motion: how far the camera moves blind, and how much longer the run takes.

Run: ``python -m benchmarks.image_gaps``. The path of `benchmarks.real_loop` in simulated time, with 0.03 px
of noise and 20 ms of latency at 30 images a second, followed in 3, 5 and 8 s; images are missing from its
middle on. *Blind*: from where the last image before the gap saw the camera to where it stands, true. *Off
the path*: the largest distance of the true camera to the path on the whole run.
"""

from __future__ import annotations

import numpy as np
from benchmarks.mapped_arm import MOUNT, scene
from benchmarks.real_loop import Points, SimulatedCamera, tracker_of

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm, CameraImage
from omniservo.safety import SafetyOptions, Step, Supervisor, VisibilityFilter, Waiting, servo
from omniservo.servoing import RestToRestLaw
from omniservo.simulation import SimulatedRobot

LATENCY = 0.02
"""[s]"""
WORLD = scene(LATENCY)
ROOMS = (0.0, 0.003, 0.006, 0.01)
"""[m]"""
DURATIONS = (3.0, 5.0, 8.0)
"""[s]"""
GAPS = (0.3, 1.0, 2.5)
"""[s]"""


class GappedCamera(SimulatedCamera):
    """Gives nothing new for ``gap`` seconds from ``begin`` on."""

    def __init__(self, robot: SimulatedRobot, points: Points, begin: float, gap: float) -> None:
        super().__init__(robot, points)
        self._span, self._clock, self._last = (begin, begin + gap), robot, super().image()

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame, outside the gap."""
        if not self._span[0] <= self._clock.time < self._span[1]:
            self._last = super().image()
        return self._last


def run(duration: float, gap: float, room: float) -> tuple[float, float, float, str]:
    """Return blind and off the path [mm], how long it took [s], and how it ended."""
    points, robot = Points(), SimulatedRobot(WORLD, rendered=False)
    robot.advance(LATENCY + 0.1)
    camera = GappedCamera(robot, points, robot.time + 0.5 * duration, gap)
    joints: list[FloatArray] = []

    def wait(seconds: float) -> None:
        robot.advance(seconds)
        joints.append(robot.read().joint_positions)

    options = SafetyOptions(blind_room=room)
    supervisor = Supervisor(robot, Arm.rx60(), MOUNT, camera=camera, wait=wait, options=options)
    tracker = tracker_of(points, LATENCY, RestToRestLaw(duration))
    steps: list[Step] = []
    blind = [0.0]

    def waited(waiting: Waiting) -> None:
        if not np.isnan(waiting.until):
            seen = WORLD.world_T_camera(robot.exposure(steps[-1].image.time)[0])
            blind.append(float(np.linalg.norm((seen.inv() * WORLD.world_T_camera(joints[-1])).translation)))

    stop = servo(
        supervisor, tracker, points, VisibilityFilter(WORLD.camera, options=options),
        time_limit=60.0, on_step=steps.append, on_wait=waited,
    )  # fmt: skip
    line = tracker.legs[0].path(np.linspace(0.0, 1.0, 2001)).translation
    start = WORLD.world_T_camera(WORLD.start_joints).inv()
    places = [(start * WORLD.world_T_camera(q)).translation for q in joints[::10]]
    off = max(float(np.linalg.norm(line - place, axis=1).min()) for place in places)
    return 1e3 * max(blind), 1e3 * off, steps[-1].time, "goal" if stop is None else stop.reason


def main() -> None:
    """Print a row for each pace, gap and room."""
    print(
        "| path followed in | images missing for | room | blind [mm] | off the path [mm] | longer by | end |"
    )
    print("|---|---|---|---|---|---|---|")
    for duration in DURATIONS:
        whole = run(duration, 0.0, 0.0)[2]
        for gap in GAPS:
            for room in ROOMS if gap == GAPS[1] else ROOMS[2:3]:
                blind, off, seconds, end = run(duration, gap, room)
                print(
                    f"| {duration:g} s | {gap:g} s | {1e3 * room:g} mm | {blind:.1f} | {off:.2f} | "
                    f"{seconds - whole:.2f} s | {end} |", flush=True,
                )  # fmt: skip


if __name__ == "__main__":
    main()
