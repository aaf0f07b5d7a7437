"""Shipped tasks with something changed."""

import json
from importlib import resources

import numpy as np

from omniservo.files import read_document
from omniservo.simulation import SimulatedCell
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
