"""``python -m omniservo.drive.main SOCKET``: the drive process; its setup comes by standard input."""

from __future__ import annotations

import gc
import pickle
import signal
import socket
import sys

from omniservo.drive.arm_opener import DriveSetup
from omniservo.drive.drive_loop import DriveLoop


def main() -> None:
    """Drive until the other process says so, or is gone."""
    line = socket.socket(fileno=int(sys.argv[1]))
    setup = pickle.load(sys.stdin.buffer)  # noqa: S301 - of the process that started this one
    if not isinstance(setup, DriveSetup):
        sys.exit("omniservo.drive.main is started by DriveClient")
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # which brakes
    gc.freeze()
    DriveLoop(line, setup).run()


if __name__ == "__main__":
    main()
