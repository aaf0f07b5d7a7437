"""Write a driver of your own (--driver own_driver.py:SocketArm): an arm that speaks JSON lines over TCP.

Prints how far the arm of own_controller.py turned, and that it stops by itself when commands end.
"""

import json
import socket
import time
from threading import Thread

import numpy as np

from omniservo.errors import ConnectionLost
from omniservo.hardware import ClockMap
from omniservo.robots import RobotState


class SocketArm:
    def __init__(self, address: str, joint_names: tuple[str, ...]) -> None:
        self.joint_names, self.watchdog = joint_names, 0.2  # the arm stops so long after the last command [s]
        self.clock, self.newest, self.lost = ClockMap(), None, ""
        self.line = socket.create_connection(address.split(":"), timeout=2.0)  # a longer silence is a loss
        self.thread = Thread(target=self.listen, daemon=True)
        self.thread.start()
        while self.read() is None:
            time.sleep(0.001)

    def listen(self) -> None:
        try:
            with self.line, self.line.makefile("rb") as stream:
                while text := stream.readline():
                    at, said = time.monotonic(), json.loads(text)
                    q, qd = (np.array([said[key][name] for name in self.joint_names]) for key in ("q", "qd"))
                    self.newest = RobotState(self.clock.monotonic(said["time"], at), q, qd)
            self.lost = "the controller closed the connection"
        except Exception as error:  # whatever it was: the joints are no longer known
            self.lost = f"joint states end: {error!r}"

    def read(self) -> RobotState | None:
        if self.lost:
            raise ConnectionLost(self.lost)
        return self.newest

    def command(self, joint_velocities: np.ndarray) -> None:
        speeds = dict(zip(self.joint_names, map(float, joint_velocities), strict=True))
        self.line.sendall(json.dumps(speeds, allow_nan=False).encode() + b"\n")

    def stop(self) -> None:
        self.command(np.zeros(len(self.joint_names)))

    def close(self) -> None:
        if not self.lost:
            self.line.shutdown(socket.SHUT_RDWR)
        self.thread.join()


if __name__ == "__main__":
    from own_controller import NAMES, rehearse, start

    rehearse(SocketArm(start(), NAMES[::-1]))
