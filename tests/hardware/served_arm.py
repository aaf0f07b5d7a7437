"""An arm and a camera behind ROS 2 topics, in a process of their own that says what it knows when asked.

Such processes are forks of one that has loaded everything, which takes longer than most of what they do.
"""

import multiprocessing
import os
import signal
import threading
import time
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from omniservo.hardware.link_faults import LinkFaults
from omniservo.hardware.ros2 import network
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.ros2_arm import Ros2Arm
from omniservo.hardware.ros2.server import Ros2Server, ServedTopics
from omniservo.robots import Arm, CameraImage, RobotState

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


FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload([__name__])


class Served:
    """The process, seen from a test."""

    def __init__(self, domain, **given):
        self.line, end = FORKS.Pipe()
        self.process = FORKS.Process(target=serve, args=(end, domain), kwargs=given)
        self.process.start()
        end.close()
        assert self.line.recv() == "served"

    def tell(self):
        self.line.send("tell")
        return self.line.recv()

    def end(self):
        self.line.close()

    @contextmanager
    def halted(self):
        """It stands, with all its threads, until the end of the `with`."""
        os.kill(self.process.pid, signal.SIGSTOP)
        threads = list(Path(f"/proc/{self.process.pid}/task").glob("*/stat"))
        while any(stat.read_text().rpartition(")")[2].split()[0] != "T" for stat in threads):
            time.sleep(1e-3)
        try:
            yield
        finally:
            os.kill(self.process.pid, signal.SIGCONT)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.end()
        self.process.join(30)
        assert self.process.exitcode == 0


def serve(line, domain, faults=None, names=NAMES, moving=False, **topics):
    """Serve until the other end of the line is closed."""
    arm = PlainArm()
    if topics.get("twist"):
        topics["arm"] = Arm.rx60()
    if moving:
        arm.command(np.full(6, 0.1))
    server = Ros2Server(
        arm, tuple(names), PlainCamera(), topics=ServedTopics(**topics), faults=LinkFaults(**(faults or {})),
        network=DdsNetwork.localhost(domain),
    )  # fmt: skip
    line.send("served")
    with suppress(EOFError):
        while line.recv():
            state = arm.read()
            q, qd = state.joint_positions.tolist(), state.joint_velocities.tolist()
            line.send({"q": q, "qd": qd, "heard": server.heard, "refused": server.refused})
    server.close()
    network._held.clear()  # as at an interpreter's end, which forks do not have: the domain says goodbye


def command_on(line, domain):
    """Command the first joint for ever; say when it moves."""
    arm, said = Ros2Arm(NAMES, np.full(6, 2.0), network=DdsNetwork.localhost(domain), patience=30), False
    while True:
        arm.command([0.2, 0, 0, 0, 0, 0])
        if not said and arm.read().joint_velocities[0] > 0.15:
            line.send("moving")
            said = True
        time.sleep(0.005)
