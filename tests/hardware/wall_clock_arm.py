"""An arm without bodies on the wall clock, and waiting for what other threads do: for tests of adapters."""

import threading
import time

import numpy as np

from omniservo.robots import ArmMode, RobotState

PATIENCE = 30.0


class WallClockArm:
    """Joints that take on commanded speeds at once, for ``kept`` seconds; `mode` may be set."""

    watchdog = 0.1

    def __init__(self, joints=(0.0, -1.5, 1.5, -1.5, -1.5, 0.0), kept=np.inf):
        self.joints, self.speeds, self.kept = np.array(joints), np.zeros(len(joints)), kept
        self.time, self.mode, self.commands, self.lock = time.monotonic(), ArmMode.READY, 0, threading.Lock()
        self.until = self.time

    def _advance(self):
        now = time.monotonic()
        self.joints = self.joints + max(min(now, self.until) - self.time, 0.0) * self.speeds
        if now >= self.until:
            self.speeds = np.zeros_like(self.speeds)
        self.time = now

    def read(self):
        with self.lock:
            self._advance()
            return RobotState(self.time, self.joints.copy(), self.speeds.copy(), self.mode)

    def command(self, joint_velocities):
        with self.lock:
            self._advance()
            self.speeds = np.array(joint_velocities, dtype=float)
            self.until = self.time + self.kept
            self.commands += 1

    def stop(self):
        self.command(np.zeros_like(self.speeds))

    def close(self):
        self.stop()


def wait_for(condition, meanwhile=lambda: None):
    """Return what the condition gives once it is true; fail where it never is."""
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, "never came about"
        meanwhile()
        time.sleep(1e-3)
    return found
