"""A stand-in for an arm's controller, which own_driver.py drives: JSON lines over TCP.

It sends {"time": s, "q": {name: rad}, "qd": {name: rad/s}} 200 times a second, takes in {name: rad/s}, and
stops the arm by itself 0.2 s after the last command. Prints its first line.
"""

import json
import select
import socket
import threading
import time
from contextlib import suppress

from omniservo.hardware import ArmConnection

NAMES = ("base", "shoulder", "elbow", "roll", "bend", "turn")
WATCHDOG = 0.2  # [s]


def start() -> str:
    """Wait for one client in a thread, and return the address, HOST:PORT."""
    server = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=control, args=(server,)).start()
    return "{}:{}".format(*server.getsockname())


def control(server: socket.socket) -> None:
    begin = now = time.monotonic()
    q, qd, heard, text = dict.fromkeys(NAMES, 0.0), dict.fromkeys(NAMES, 0.0), now, b""
    with server, server.accept()[0] as line, suppress(OSError):
        while True:
            if select.select([line], [], [], 0.005)[0]:
                if not (part := line.recv(4096)):
                    return
                *whole, text = (text + part).split(b"\n")
                qd, heard = (json.loads(whole[-1]), time.monotonic()) if whole else (qd, heard)
            before, now = now, time.monotonic()
            qd = qd if now - heard < WATCHDOG else dict.fromkeys(NAMES, 0.0)
            q = {name: q[name] + qd[name] * (now - before) for name in NAMES}
            line.sendall(json.dumps({"time": now - begin, "q": q, "qd": qd}).encode() + b"\n")


def rehearse(arm: ArmConnection) -> None:
    """Turn an arm's first joint, fall silent until the arm stands, and print what it did."""
    first = arm.joint_names[0]
    while arm.read().joint_positions[0] < 0.05:
        arm.command([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
        time.sleep(0.01)
    while arm.read().joint_velocities.any():
        time.sleep(0.01)
    print(f"{first} turned by {arm.read().joint_positions[0]:.2f} rad, and stopped when commands ended")
    arm.close()


if __name__ == "__main__":
    host, _, port = start().rpartition(":")
    with socket.create_connection((host, int(port))) as line, line.makefile() as stream:
        print(stream.readline(), end="")
