"""How fast and how late an arm of Universal Robots is by RTDE, over the loop-back device.

The stand-in of the controller is a process of its own; both share the cores with whatever else runs.

    python -m benchmarks.rtde_line [SECONDS]
"""

import multiprocessing
import os
import sys
import time
from threading import Lock

import numpy as np

from omniservo.errors import ConnectionLost
from omniservo.hardware.rtde import RtdeArm
from omniservo.hardware.rtde.server import UrStandIn
from omniservo.robots import RobotState


class Integrator:
    """Joints that take on speeds at once."""

    def __init__(self) -> None:
        self.q, self.qd, self.time, self.lock = np.zeros(6), np.zeros(6), time.monotonic(), Lock()

    def read(self) -> RobotState:
        """See ArmDriver."""
        with self.lock:
            now = time.monotonic()
            self.q, self.time = self.q + (now - self.time) * self.qd, now
            return RobotState(now, self.q.copy(), self.qd.copy())

    def command(self, joint_velocities: np.ndarray) -> None:
        """See ArmDriver."""
        self.read()
        self.qd = np.array(joint_velocities)

    def stop(self) -> None:
        """See ArmDriver."""
        self.command(np.zeros(6))

    def close(self) -> None:
        """See ArmDriver."""
        self.stop()


def serve(ports: multiprocessing.SimpleQueue) -> None:
    """Be the controller."""
    stand_in = UrStandIn(Integrator())
    ports.put((stand_in.address, stand_in.ports))
    time.sleep(1e6)


def quantiles(seconds: list[float], scale: float, unit: str) -> str:
    """Return the median and the 99th percentile in words."""
    low, high = np.quantile(seconds, [0.5, 0.99]) * scale
    return f"median {low:.3g} {unit}, 99% {high:.3g} {unit}"


def main(duration: float) -> None:
    """Print the figures."""
    ports: multiprocessing.SimpleQueue = multiprocessing.SimpleQueue()
    process = multiprocessing.Process(target=serve, args=(ports,), daemon=True)
    process.start()
    address, others = ports.get()
    opening = []
    for _ in range(10):
        begin = time.perf_counter()
        arm = RtdeArm(address, script_port=others.scripts[0], dashboard_port=others.dashboard)
        opening.append(time.perf_counter() - begin)
        arm.close()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"opened, program running: {quantiles(opening, 1e3, 'ms')}")
    arm = RtdeArm(address, script_port=others.scripts[0], dashboard_port=others.dashboard)
    ages, writes, echoes = [], [], []
    states, seen, end = 0, None, time.monotonic() + duration
    sent: tuple[int, float] | None = None
    flip = 0.1
    due = time.monotonic()
    while time.monotonic() < end:
        state = arm.read()
        if state is not seen:
            ages.append(time.monotonic() - state.time)
            states, seen = states + 1, state
        if sent and arm.commands_acted_on >= sent[0]:
            echoes.append(time.monotonic() - sent[1])
            sent = None
        if time.monotonic() >= due:
            due += 0.005
            flip = -flip
            begin = time.perf_counter()
            arm.command(np.full(6, flip))
            writes.append(time.perf_counter() - begin)
            sent = sent or (arm.commands_sent, time.monotonic())
        time.sleep(1e-4)
    print(f"states: {states / duration:.0f}/s, age when first seen {quantiles(ages, 1e3, 'ms')}")
    print(f"a command, 200/s: {quantiles(writes, 1e6, 'µs')}")
    print(f"command → its echo read: {quantiles(echoes, 1e3, 'ms')}")
    process.kill()
    begin = time.perf_counter()
    try:
        while True:
            arm.read()
            time.sleep(1e-4)
    except ConnectionLost as error:
        print(f"controller killed, known after {1e3 * (time.perf_counter() - begin):.1f} ms: {error}")
    arm.close()


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)
