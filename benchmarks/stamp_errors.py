"""What late images, few images and wrong time stamps do to how exactly a task's path is followed.

Run: ``python -m benchmarks.stamp_errors [--task ur5e-table]``. The task in simulated time, its dots drawn
without noise; stamps are wrong from the first image of the motion on. The error is the distance of the
camera, at the instants that the stamps name, to the place on the plan's way where the reference then was.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace

import numpy as np
from benchmarks.pictured_run import off_the_way
from tests.runs.changed_task import DrawingRobot, DrawnCell, UnfilmedTruth

from omniservo.robots import CameraImage
from omniservo.runs import run_task
from omniservo.scenes import Scene
from omniservo.simulation.simulated_robot import Exposure
from omniservo.tasks import Task, load_task

STANDING = 0.3
"""So long stamps are right [s]: the arm stands."""


@dataclass(frozen=True)
class Stamps:
    """How images come in, and what their stamps are off by."""

    rate: float
    late: float
    """from exposure to delivery [s]"""
    shift: float = 0.0
    """of all stamps [s]"""
    jitter: float = 0.0
    """besides, up to so much either way, evenly [s]"""

    def __str__(self) -> str:
        words = f"{self.rate:g} images a second, {1e3 * self.late:.0f} ms late"
        shift = f", stamps off by {1e3 * self.shift:+.0f} ms" if self.shift else ""
        return words + shift + (f", stamps off by ± {1e3 * self.jitter:.0f} ms" if self.jitter else "")


CASES = (
    Stamps(30.0, 0.02),
    Stamps(17.0, 0.06),
    *(Stamps(17.0, 0.06, shift) for shift in (0.005, -0.005, 0.01, -0.01)),
    *(Stamps(17.0, 0.06, jitter=jitter) for jitter in (0.005, 0.01, 0.02)),
)


class WronglyStamped(DrawingRobot):
    """A simulated robot whose images have wrong stamps."""

    def __init__(self, scene: Scene, seed: int, stamps: Stamps) -> None:
        super().__init__(scene, seed)
        self._stamps, self._random = stamps, np.random.default_rng(seed)
        self._told: dict[float, float] = {}

    def image(self) -> CameraImage | None:
        """Return the newest frame, under the stamp that it has."""
        image = super().image()
        if image is None or image.time < STANDING:
            return image
        if image.time not in self._told:
            off = self._stamps.shift + self._stamps.jitter * self._random.uniform(-1.0, 1.0)
            self._told[image.time] = image.time + off
        return replace(image, time=self._told[image.time])

    def exposure(self, time: float) -> Exposure:
        """Return what was exposed under a stamp."""
        true = {told: true for true, told in self._told.items()}
        return super().exposure(true.get(time, time))


def row(task: Task, stamps: Stamps) -> str:
    """Return a row of the table."""

    class Cell(DrawnCell):
        def __init__(self, task: Task, seed: int = 0) -> None:
            super().__init__(task, seed)
            if seed == 0:  # the goal is taught in a cell of its own
                self.robot = WronglyStamped(self.robot.world.scene, seed, stamps)
                self.truth = UnfilmedTruth(self.robot)

    sensor = task.sensor.model_copy(update={"rate": stamps.rate, "latency": stamps.late})
    result = run_task(task.model_copy(update={"sensor": sensor}), Cell, filmed=False)
    off = off_the_way(result, result.log.column("measured_position"))
    end = result.log.stop_reason or "goal"
    return f"| {stamps} | {np.sqrt((off**2).mean()):.2f} / {off.max():.2f} | {end} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--task", default="ur5e-table")
    given = parser.parse_args()
    print("| images | rms / max [mm] | end |\n|---|---|---|")
    for stamps in CASES:
        print(row(load_task(given.task), stamps), flush=True)


if __name__ == "__main__":
    main()
