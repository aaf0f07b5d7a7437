"""Shipped tasks with something changed."""

import json
from importlib import resources

import numpy as np

from omniservo.files import read_document
from omniservo.robots import CameraImage
from omniservo.simulation import SimulatedCell, SimulatedRobot
from omniservo.simulation.projected_dots import ProjectedDots
from omniservo.simulation.simulated_truth import SimulatedTruth


class UnfilmedTruth(SimulatedTruth):
    """The truth without its pictures from outside, of which no claim here is and which take long."""

    def outside_picture(self, joints, time=None, *, quick=False):
        return np.zeros((4, 4, 3), dtype=np.uint8)


class PlainCell(SimulatedCell):
    """The simulator, but for pictures from outside."""

    def __init__(self, task, seed=0):
        super().__init__(task, seed)
        self.truth = UnfilmedTruth(self.robot)


class DrawingRobot(SimulatedRobot):
    """Its frames show the scene's dots alone, drawn in a tenth of the time that rendering takes."""

    def __init__(self, scene, seed=0):
        super().__init__(scene, seed)
        self._dots = ProjectedDots(scene)

    def image(self):
        exposure = self.newest_exposure()
        if exposure is None:
            return None
        if self._picture is None or self._picture.time != exposure.time:
            self._picture = CameraImage(exposure.time, self._dots.drawn(exposure))
        return self._picture


class DrawnCell(PlainCell):
    """For claims of what is made of dots that are seen: nothing hides them, and there is no noise."""

    def __init__(self, task, seed=0):
        super().__init__(task, seed)
        self.robot = DrawingRobot(self.robot.world.scene, seed)
        self.truth = UnfilmedTruth(self.robot)


def shipped(name):
    """The document of a shipped task, free to be changed."""
    with resources.as_file(resources.files("omniservo.tasks") / "shipped" / f"{name}.yaml") as path:
        return read_document(path)


def short(rate, duration):
    """The document of a task that is soon done: images a second, and seconds."""
    document = shipped("paper-example-1")
    document["sensor"] = document.get("sensor", {}) | {"rate": rate}
    document["servo"] = document.get("servo", {}) | {"duration": duration, "time_law": "rest-to-rest"}
    return document


def written(folder, document):
    """A task file with this document."""
    path = folder / "task.yaml"
    path.write_text(json.dumps(document))  # JSON is YAML
    return path
