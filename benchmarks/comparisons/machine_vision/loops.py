"""Runs the servo loops of machinevision-toolbox-python: JSON in, JSON out; it imports nothing of ours.

Its OpenCV replaces the one that omniservo needs, so it is run by an interpreter of its own (see `compare`).
"""

import importlib
import io
import json
import sys
from contextlib import redirect_stdout
from importlib.metadata import version
from itertools import pairwise
from time import process_time
from typing import Any

import machinevisiontoolbox as toolbox
import numpy as np
from spatialmath import SE3

SERVOING = importlib.import_module("machinevisiontoolbox.VisualServo")  # a class has the module's name
RHO = 1e-5
"""[m] of a pixel: any will do"""


class Recorded:
    """Stands for SE3 where a law moves its camera, and keeps the twists that it asks for."""

    def __init__(self) -> None:
        self.twists: list[list[float]] = []

    def Delta(self, twist: np.ndarray) -> SE3:
        """Keep the twist (6,), and do as the toolbox does."""
        self.twists.append(np.asarray(twist).tolist())
        return SE3.Delta(twist)

    def __call__(self, *given: object) -> SE3:
        """Make a pose."""
        return SE3(*given)


def loop(law: str, given: dict[str, Any], start: list[list[float]]) -> dict[str, Any]:
    """Return poses, twists and CPU time of a step of one run."""
    camera = toolbox.CentralCamera(
        f=given["focal"] * RHO, rho=RHO, imagesize=given["size"], pp=given["centre"], pose=SE3(start)
    )
    points, goal = np.array(given["points"]).T, SE3(np.array(given["goal"]))
    recorded = SERVOING.SE3 = Recorded()
    shared = {"P": points, "pose_0": SE3(start), "lmbda": given["gain"], "eterm": 0.0, "graphics": False}
    if law == "IBVS":
        servo = toolbox.IBVS(camera, p_d=camera.project_point(points, pose=goal), **shared)
    else:
        servo = toolbox.PBVS(camera, pose_g=SE3(), pose_d=goal.inv(), **shared)
    before, poses = process_time(), [start]
    with redirect_stdout(io.StringIO()):
        try:
            servo.run(given["steps"])
        except Exception as error:  # such as OpenCV's, of a camera that is led away: the run ends there
            print(type(error).__name__)
    steps = len(servo.history)
    seconds = (process_time() - before) / max(steps, 1)
    poses += [np.array(each.pose.A).tolist() for each in servo.history]
    if law == "PBVS":  # moves by a pose, not by a twist: its translation and rotation vector are kept
        recorded.twists = [relative(a, b) for a, b in pairwise(poses)]
    return {"law": law, "poses": poses, "twists": recorded.twists, "seconds": seconds}


def relative(before: list[list[float]], after: list[list[float]]) -> list[float]:
    """Return translation and rotation vector from one pose to the next."""
    moved = SE3(np.array(before), check=False).inv() * SE3(np.array(after), check=False)
    angle, axis = moved.angvec()
    return [*moved.t.tolist(), *(angle * np.asarray(axis)).tolist()]


def main() -> None:
    """Run every law from every start."""
    given = json.load(sys.stdin)
    runs = [loop(law, given, start) for start in given["starts"] for law in ("IBVS", "PBVS")]
    json.dump({"version": version("machinevision-toolbox-python"), "runs": runs}, sys.stdout)


if __name__ == "__main__":
    main()
