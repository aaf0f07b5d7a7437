"""An arm and a camera behind ROS 2 topics: `python -m tests.hardware.served_arm JSON` as a process.

It says what it knows for every line that it is sent.
"""

import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from omniservo.hardware.link_faults import LinkFaults
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.server import Ros2Server, ServedTopics
from omniservo.robots import Arm, CameraImage, RobotState

ROOT = Path(__file__).resolve().parents[2]
NAMES = ("base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3")
START = np.array([0.1, -0.7, 0.9, 0.4, 0.5, -0.6])


class PlainArm:
    """Joints whose velocity follows the commanded one with a lag of 20 ms, at 5 rad/s² at most."""

    def __init__(self):
        self.lock, self.time = threading.Lock(), time.monotonic()
        self.q, self.qd, self.wanted = START.copy(), np.zeros(6), np.zeros(6)

    def read(self):
        with self.lock:
            now = time.monotonic()
            while self.time < now:
                step = min(now - self.time, 1e-3)
                self.qd = self.qd + np.clip((self.wanted - self.qd) / 0.02, -5.0, 5.0) * step
                self.q = self.q + self.qd * step
                self.time += step
            return RobotState(now, self.q, self.qd)

    def command(self, velocities):
        self.read()
        self.wanted = np.array(velocities, dtype=float)

    def stop(self):
        self.command(np.zeros(6))


class PlainCamera:
    """Images 30 times a second whose rows count them."""

    def __init__(self, width=64, height=48):
        self.shape, self.begin = (height, width), time.monotonic()

    def image(self):
        number = int((time.monotonic() - self.begin) * 30)
        return CameraImage(self.begin + number / 30, np.full(self.shape, number % 256, np.uint8))


class Served:
    """The process, seen from a test."""

    def __init__(self, domain, **given):
        code = json.dumps({"domain": domain, **given})
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.hardware.served_arm", code],
            cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        assert self.process.stdout.readline() == "served\n"

    def tell(self):
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.process.stdin.close()
        self.process.stdout.close()
        self.process.wait(30)


def main():
    given = json.loads(sys.argv[1])
    arm, network = PlainArm(), DdsNetwork.localhost(given.pop("domain"))
    faults, names = LinkFaults(**given.pop("faults", {})), tuple(given.pop("names", NAMES))
    if given.get("twist"):
        given["arm"] = Arm.rx60()
    if given.pop("moving", False):
        arm.command(np.full(6, 0.1))
    server = Ros2Server(
        arm, names, PlainCamera(), topics=ServedTopics(**given), faults=faults, network=network
    )
    print("served", flush=True)  # noqa: T201
    for _ in sys.stdin:
        state = arm.read()
        q, qd = state.joint_positions.tolist(), state.joint_velocities.tolist()
        print(json.dumps({"q": q, "qd": qd, "heard": server.heard, "refused": server.refused}), flush=True)  # noqa: T201
    server.close()


if __name__ == "__main__":
    main()
